#!/usr/bin/env bash
# Build the site of docs/ into FOLDER (site), where no file of ours is needed to read it: scripts/docs.sh [FOLDER]
# A warning fails, and so does a link into nowhere. The tools (requirements/docs.txt) are in .venv/.docs, apart from
# what runs. Exit code 0: built; 1: a page is wrong; 2: the tools could not be installed.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
out=$(realpath -m "${1:-site}")
bash scripts/bootstrap.sh >/dev/null || exit 2
tools=$PWD/.venv/.docs
if ! cmp -s requirements/docs.txt "$tools/.installed"; then
    echo 'docs: installing requirements/docs.txt' >&2
    rm -rf "$tools"
    .venv/bin/python -m venv "$tools"
    bash scripts/install.sh "$tools/bin/python" requirements/docs.txt .venv/.docs-log || exit 2
    cp requirements/docs.txt "$tools/.installed"
fi
if [[ -e $out && ! -e $out/sitemap.xml && -n $(ls -A "$out") ]]; then
    echo "docs: $out is there and no site: it would be emptied; name another folder" >&2
    exit 1
fi
code=0 # without --quiet, which would not count warnings
PYTHONPATH='' NO_MKDOCS_2_WARNING=true "$tools/bin/python" -m mkdocs build --strict --site-dir "$out" 2>"$tools/.log" || code=1
grep -v '^INFO \|^ *$' "$tools/.log" >&2 || true
((code == 0)) || exit 1
printf 'docs: %s pages: open %s/index.html\n' "$(find "$out" -maxdepth 1 -name '*.html' | wc -l)" "$out"
