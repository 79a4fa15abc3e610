#!/usr/bin/env bash
# The images, with a real engine: any user, a read-only root, Compose with each fault, the live page. Prints a table, and
# fails if a row is not what it should be. Builds trunk:slim and trunk:cluster first, unless TRUNK_BUILT is set.
# Leaves neither containers nor volumes; both images stay.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
export PREFIX=trunkcheck SCENARIO=fig8 CONTROLLER=fuzzy_pid TARGET=slim
work=$(mktemp -d)
chmod 1777 "$work"
docker version >/dev/null 2>&1 || { echo 'check_docker: no Docker engine answers here' >&2; exit 3; }
if docker compose version >/dev/null 2>&1; then compose=(docker compose); else compose=(docker-compose); fi
compose+=(--project-name "$PREFIX" --file docker/compose.yaml --profile live --profile sweep --profile plan)

clean() {
    "${compose[@]}" down --volumes --timeout 5 >/dev/null 2>&1 || true
    docker rm --force --volumes "$PREFIX" >/dev/null 2>&1 || true
}
trap 'clean; rm -rf "$work"' EXIT
wrong=0
row() { # WHAT EXPECTED FOUND
    local verdict=ok
    [[ $3 == $2 ]] || { verdict=WRONG; wrong=$((wrong + 1)); } # EXPECTED is a pattern
    printf '%-38s %-36s %-36s %s\n' "$1" "$2" "$3" "$verdict"
}
until_true() { # COMMAND...: a condition that comes true, however busy the machine is
    until "$@" >/dev/null 2>&1; do sleep 0.2; done
}
container() { "${compose[@]}" ps --quiet "$1" 2>/dev/null; }
code_of() { docker inspect --format '{{.State.ExitCode}}' "$1"; }
inside() { # COMMAND...: in the volume of the runs
    docker run --rm --volume "${PREFIX}_recordings:/recordings" trunk:slim "$@"
}

# ── images ─────────────────────────────────────────────────────────────────────────────────────────────
if [[ -z ${TRUNK_BUILT:-} ]]; then
    for target in slim cluster; do
        docker/build.sh "$target" >"$work/build.log" 2>&1 || { tail -20 "$work/build.log" >&2; exit 1; }
    done
fi
printf '%-38s %-36s %-36s\n' what expected found
for target in slim cluster; do
    size=$(docker image inspect --format '{{.Size}}' "trunk:$target")
    row "size of $target, MB" '[0-9]*' "$((size / 1000000))"
done
least=(--rm --read-only --tmpfs /tmp --cap-drop ALL --network none --memory 512m --volume "$work:/recordings")
code=0 said=$(docker run "${least[@]}" --user 4321:4321 trunk:slim bash -c '
    trunk run fig8 --lockstep --duration 1 --output any && trunk verify any && trunk plot any -o any.png' 2>&1) || code=$?
row 'any uid, read-only, no network' '0, no warning' "$code, $(grep -qiE 'warning|denied' <<<"$said" && echo warns || echo no warning)"
row 'whose file' 4321 "$(stat -c %u "$work/any/run.mcap")"

# ── Compose, with each fault ───────────────────────────────────────────────────────────────────────────
judged() { # the exit code of trunk verify: 0 verified, 1 diverged, 2 inconclusive
    local code=0
    inside bash -c 'trunk verify /recordings/*.mcap' >/dev/null 2>&1 || code=$?
    printf '%s' "$code"
}
fault() { # NAME EXPECTED COMMAND, evaluated during a lock-step run of 20 s
    clean
    "${compose[@]}" run --rm plan trunk plan fig8 --controller fuzzy_pid --lockstep --duration 20 \
        --output /recordings/params.yaml --force >/dev/null 2>&1
    "${compose[@]}" up --detach simulator >/dev/null 2>&1
    simulator=$(container simulator) recorder=$(container recorder) controller=$(container controller)
    discovery=$(container discovery)
    until_true docker exec "$recorder" sh -c 'test $(stat -c %s /recordings/*.mcap) -gt 200000'
    eval "$3" >/dev/null
    local code recorded
    code=$(docker wait "$simulator")
    docker stop --time 20 "$recorder" >/dev/null
    recorded=$(code_of "$recorder")
    row "$1" "$2" "simulator $code, recorder $recorded, verify $(judged)"
}
pause() { docker pause "$controller" && sleep 3 && docker unpause "$controller"; } >/dev/null
fault 'nothing' 'simulator 0, recorder 0, verify 0' 'true'
fault 'discovery server killed' 'simulator 0, recorder 0, verify 0' 'docker kill "$discovery"'
fault 'controller paused for 3 s' 'simulator 0, recorder 0, verify 0' 'pause'
fault 'controller killed' 'simulator 1, recorder 1, verify 2' 'docker kill "$controller"'
fault 'recorder killed' 'simulator 1, recorder 137, verify 2' 'docker kill "$recorder"'
fault 'controller cut off' 'simulator 1, recorder 1, verify 2' 'docker network disconnect "${PREFIX}_trunk" "$controller"'
fault 'simulator stopped' 'simulator 1, recorder 1, verify 2' 'docker stop --time 20 "$simulator"'
clean

# ── the live page behind a published port ──────────────────────────────────────────────────────────────
url=http://127.0.0.1:${PORT:-18080}
docker run --detach --name "$PREFIX" --cap-drop ALL --publish "${url#http://}:8080" trunk:slim \
    trunk live demo --host 0.0.0.0 --port 8080 --url "$url" >/dev/null
status() { curl --silent --output /dev/null --write-out '%{http_code}' "$url" "$@"; }
until_true status
row 'live page, its own address' 200 "$(status)"
row 'live page, another host' 403 "$(status --header 'Host: evil.example')"
row "live page, the container's address" 403 "$(status --header 'Host: 127.0.0.1:8080')"
docker rm --force --volumes "$PREFIX" >/dev/null

# ── a sweep on a cluster, a worker killed, and alone ───────────────────────────────────────────────────
printf '%s\n' 'scenario: fig6' 'rate: 200' 'duration: 3.0' 'controllers: [pid, fuzzy_pid]' 'block: 5' 'vary:' \
    '  delay: {parameter: simulator.sensor.delay, from: 0.0, to: 0.02, steps: 50}' >"$work/study.yaml"
"${compose[@]}" up --detach --scale worker=3 scheduler worker >/dev/null 2>&1
docker run --rm --volume "${PREFIX}_recordings:/recordings" --volume "$work:/from:ro" trunk:slim cp /from/study.yaml /recordings/
"${compose[@]}" run --rm sweep trunk sweep study.yaml -o cluster.parquet --scheduler tcp://scheduler:8786 >"$work/sweep.log" 2>&1 &
running=$!
until_true grep -q '%' "$work/sweep.log"
docker kill "$(container worker | head -1)" >/dev/null
code=0
wait "$running" || code=$?
inside trunk sweep study.yaml --jobs 1 -o alone.parquet >/dev/null 2>&1
row 'sweep on a cluster, a worker killed' '0, identical*' "$code, $(inside trunk diff cluster.parquet alone.parquet | sed -n 1p)"

((wrong == 0)) || { printf '\ncheck_docker: %d rows are WRONG\n' "$wrong" >&2; exit 1; }
