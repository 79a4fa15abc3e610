#!/usr/bin/env bash
# Build the site of docs/ into FOLDER (site): scripts/docs.sh [FOLDER]
# A warning or a broken link fails. The pages open as files too; the search box needs a server.
# The tables of parameters and documents are made anew, by scripts/docs_tables.py.
# Labs (docs/lab.md) are made where clang and lld are; TRUNK_LABS=FOLDER has them ready, TRUNK_LABS=no leaves them out.
# The tools (requirements/docs.txt) are in .venv/.docs, apart from what a run needs.
# Exit code 0: built; 1: a page is wrong; 2: the tools could not be installed.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
out=$(realpath -m "${1:-site}")
bash scripts/bootstrap.sh >/dev/null || exit 2
tools=$PWD/.venv/.docs
exec 9>>.venv/.docs-lock
flock 9 # one at a time
if ! cmp -s requirements/docs.txt "$tools/.installed"; then
    echo 'docs: installing requirements/docs.txt' >&2
    rm -rf "$tools"
    .venv/bin/python -m venv "$tools"
    bash scripts/install.sh "$tools/bin/python" requirements/docs.txt .venv/.docs-log || exit 2
    cp requirements/docs.txt "$tools/.installed"
fi
if [[ -e $out && ! -e $out/sitemap.xml && -n $(ls -A "$out") ]]; then
    echo "docs: $out exists and is not a site: it would be emptied; name another folder" >&2
    exit 1
fi
labs=$PWD/.venv/.labs
make_lab() { # NAME SCENARIO ARGUMENTS...
    (source scripts/env.sh && trunk lab "${@:2}" -o "$labs/$1.html" --force >&2)
}
if [[ -z ${TRUNK_LABS:-} ]] && ! command -v clang wasm-ld >/dev/null && ! .venv/bin/python -c 'import ziglang' 2>/dev/null; then
    echo 'docs: clang or lld not found (requirements/lab.txt brings them): the site has no labs' >&2
elif [[ -z ${TRUNK_LABS:-} ]]; then
    sources=$(find ros2_ws/src -name '*.py' -o -name '*.js' -o -name '*.css' -o -name '*.j2' -o -name '*.yaml' |
        sort | xargs sha256sum | sha256sum)
    if [[ $sources != "$(cat "$labs/.made" 2>/dev/null)" ]]; then
        rm -rf "$labs" && mkdir "$labs"
        for figure in fig6 fig7 fig8 fig9 demo; do make_lab "$figure" "$figure" || exit 1; done
        make_lab free demo --controller fuzzy_pid --controller pid --controller lqr --controller computed_torque \
            --duration 20 --set disturbance.pulse.magnitude=0 || exit 1
        echo "$sources" >"$labs/.made"
    fi
    export TRUNK_LABS=$labs
fi
export TRUNK_TABLES=$PWD/.venv/.tables
mkdir -p "$TRUNK_TABLES"
(source scripts/env.sh && python scripts/docs_tables.py "$TRUNK_TABLES") || exit 1
code=0 # without --quiet, which would not count warnings
PYTHONPATH='' NO_MKDOCS_2_WARNING=true "$tools/bin/python" -m mkdocs build --strict --site-dir "$out" 2>"$tools/.log" || code=1
grep -v '^INFO \|^ *$' "$tools/.log" >&2 || true
((code == 0)) || exit 1
printf 'docs: %s pages in %s; to read them: python3 -m http.server --bind 127.0.0.1 --directory %q\n' \
    "$(find "$out" -maxdepth 1 -name '*.html' ! -name 404.html | wc -l)" "$out" "$out"
