#!/usr/bin/env bash
# All checks, the same for a person and for CI: scripts/test.sh [--quick | --all | pytest arguments]
# Some tests run in part: another share after each commit, or with another TRUNK_EPOCH. --all: all at once.
# --quick, between edits: what imports a changed file, without processes, browser and what takes a second or more,
# and a share of the virtual world and of the same bits.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null || { echo 'test: FAILED: bootstrap' >&2; exit 1; }
source scripts/env.sh
# Thousands of processes are started: wherever Python is told to keep no bytecode, each would compile anew.
unset PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX=$PWD/.venv/.bytecode

failed=()
stage() { # NAME COMMAND...
    printf '\n── %s\n' "$1"
    (measured "$kept/cost" "${@:2}") || failed+=("$1")
    [[ $2 == said ]] || cost "$kept/cost" "$1"
}
# Run a command in a shell of its own; write there how many seconds its processes worked, the system's too, and it took.
measured() { # FILE COMMAND...
    local code=0 began=${EPOCHREALTIME/[.,]/}
    "${@:2}" || code=$?
    awk -v us=$((${EPOCHREALTIME/[.,]/} - began)) '{ printf "%.3f\t%.3f", ($16 + $17) / 100, us / 1e6 }' \
        "/proc/$BASHPID/stat" >"$1"
    return "$code"
}
cost() { printf '%s\t%s\n' "$(<"$1")" "$2" | tee -a "$TRUNK_DURATIONS" >>"$kept/costs"; } # FILE STAGE

# A stage of one process runs beside those that follow it; `settle` waits for it and prints what it said.
names=() pids=() codes=()
beside() { # NAME COMMAND...
    measured "$kept/cost of ${#names[@]}" "${@:2}" >"$kept/${#names[@]}" 2>&1 &
    names+=("$1") pids+=($!)
}
said() { # NUMBER: of one that has ended
    cat "$kept/$1"
    return "${codes[$1]}"
}
settle() {
    local i
    for i in "${!names[@]}"; do
        codes[i]=0
        wait "${pids[i]}" || codes[i]=$?
        stage "${names[i]}" said "$i"
        cost "$kept/cost of $i" "${names[i]}"
    done
    names=() pids=() codes=()
}

syntax() {
    local script
    for script in scripts/*.sh scripts/standin/ros2 .ci/run; do
        bash -n "$script" || return
        [[ -x $script || $script == */env.sh ]] || { echo "$script: not executable" && return 1; }
    done
}

labs() {
    command -v clang wasm-ld >/dev/null || python -c 'import ziglang' 2>/dev/null ||
        bash scripts/install.sh python requirements/lab.txt "$kept/log" || true
}

# What a change concerns, and, of what any law does, the shares of this epoch.
pytest_quick() {
    local code=0
    ((!${#files[@]})) || "${run[@]}" -n auto -q -m 'not (graph or browser or slow)' "${files[@]}" "$@" || code=$?
    "${run[@]}" -n auto -q -m 'not (graph or browser or long)' tests/seeds tests/same_bits "$@" || code=$?
    return "$code"
}

kept=$(mktemp -d)
export TRUNK_SKIPPED=$kept/skipped TRUNK_DURATIONS=$PWD/.venv/durations.tsv
: >"$TRUNK_SKIPPED" >"$TRUNK_DURATIONS"
# Which share of the tests that run in part (conftest.py).
TRUNK_EPOCH=${TRUNK_EPOCH:-$(git rev-list --count HEAD 2>/dev/null || echo 0)}
export TRUNK_EPOCH
trap 'rm -rf "$kept"' EXIT
run=(python -m pytest --dist worksteal)
left=''

stage 'shell syntax' syntax
stage 'ruff check' ruff check
stage 'ruff format' ruff format --check
stage arrows lint-imports
stage licences python scripts/licences.py
if [[ ${1:-} == --quick ]]; then
    beside mypy mypy
    mapfile -t files < <(python -m tests.needed)
    stage "pytest: what a change concerns (${#files[@]} files)" pytest_quick "${@:2}"
    settle
    left='; not run: what the change does not concern; processes, browser, slow ones (scripts/test.sh)'
elif (($#)) && [[ $1 != --all ]]; then
    stage mypy mypy
    stage pytest python -m pytest "$@"
else
    some=' and not long'
    left='; the rest in their turn (scripts/test.sh --all)'
    [[ ${1:-} != --all ]] || some='' left=''
    # Where one cannot be had, its tests are skipped and say why.
    beside 'a browser, for tests' eval 'bash scripts/browser.sh || true'
    beside 'clang and lld, for labs' labs
    settle
    beside mypy nice -n 3 mypy
    # colcon finds and runs each package's pytest: a few tests of each, as pytest runs them all.
    few='python_files=test_units.py test_events.py test_source.py test_config.py test_stopping.py test_recorded_run.py
        test_columns.py test_terminal.py'
    beside 'colcon test: a few' bash scripts/colcon_test.sh -q "--override-ini=$few"
    # Some wait, for a browser or a process of their own: one test more at once than there are cores. They give way
    # to the graph's, which run beside them.
    beside 'pytest: in one process' nice -n 3 "${run[@]}" -n "$(($(nproc) + 1))" -m "not graph$some" --durations=8
    mapfile -t files < <(grep -rlE 'mark\.graph' tests --include='test_*.py')
    beside 'pytest: the graph, virtual' python -m pytest -p tests.graph.virtual -m virtual --durations=8 "${files[@]}"
    # Processes wait for each other more than they work: two tests at once for each core. Each worker loads
    # the files that it collects.
    stage 'pytest: the graph' "${run[@]}" -n "$((2 * $(nproc)))" -m "graph$some" --durations=8 "${files[@]}"
    settle
fi

printf '\nprocessor time, time: each stage; the ten dearest folders of tests (every test: .venv/durations.tsv)\n'
awk -F '\t' '{ printf "%6d s %6d s  %s\n", $1, $2, $3 }' "$kept/costs"
awk -F '\t' 'sub(/\/[^\/]*::.*/, "", $3) { work[$3] += $1; wall[$3] += $2 }
    END { for (folder in work) printf "%6d s %6d s  %s\n", work[folder], wall[folder], folder }' "$TRUNK_DURATIONS" | sort -rn | head
# Each reason once, with the number of all its tests.
skipped=$(awk '{ count = $1; sub(/^[0-9]+ /, ""); tests[$0] += count }
    END { for (reason in tests) printf "%d (%s)\n", tests[reason], reason }' "$TRUNK_SKIPPED" | sort -k2 | paste -sd';' | sed 's/;/; /g')
[[ -z $skipped ]] || left="; skipped: $skipped$left"
if ((${#failed[@]})); then
    printf '\ntest: FAILED:%s (TRUNK_EPOCH=%s)%s\n' "$(printf ' %s,' "${failed[@]}" | sed 's/,$//')" "$TRUNK_EPOCH" "$left" >&2
    exit 1
fi
printf '\ntest: all passed (TRUNK_EPOCH=%s)%s\n' "$TRUNK_EPOCH" "$left"
