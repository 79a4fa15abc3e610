#!/usr/bin/env bash
# Build the site of docs/ into FOLDER (site): scripts/docs.sh [FOLDER]
# A warning or a broken link fails. The pages open as files too; the search box needs a server.
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
code=0 # without --quiet, which would not count warnings
PYTHONPATH='' NO_MKDOCS_2_WARNING=true "$tools/bin/python" -m mkdocs build --strict --site-dir "$out" 2>"$tools/.log" || code=1
grep -v '^INFO \|^ *$' "$tools/.log" >&2 || true
((code == 0)) || exit 1
printf 'docs: %s pages in %s; to read them: python3 -m http.server --bind 127.0.0.1 --directory %q\n' \
    "$(find "$out" -maxdepth 1 -name '*.html' ! -name 404.html | wc -l)" "$out" "$out"
