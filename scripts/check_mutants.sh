#!/usr/bin/env bash
# Change the pure cores one operator at a time and see whether their tests notice: docs/maintaining.md.
#
#   scripts/check_mutants.sh [MODULE[:LINE,...]]...     default: all of scripts/mutants/modules.py
#
# Works on a copy in a temporary folder. Exit code 1 where less than 90 % of a module's mutants are killed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh

folder=$(mktemp -d "${TMPDIR:-/tmp}/trunk-mutants.XXXXXX")
trap 'rm -rf "$folder"' EXIT
bash scripts/install.sh python requirements/mutants.txt "$folder/log" --target "$folder/tool"
mkdir "$folder/tree"
git ls-files -coz --exclude-standard --deduplicate | xargs -0 cp --parents -t "$folder/tree"
git -C "$folder/tree" init -q # a recording without a commit is a finding
git -C "$folder/tree" add -A
git -C "$folder/tree" -c user.name=copy -c user.email=copy@localhost commit -qm copy

for package in "$folder"/tree/ros2_ws/src/*/; do # before the built packages, which link to the checkout
    PYTHONPATH=${package%/}:$PYTHONPATH
done
export PYTHONPATH=$PYTHONPATH:$folder/tree:$folder/tool XDG_CACHE_HOME=$folder/cache
export PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 HYPOTHESIS_PROFILE=mutants
cd "$folder/tree"
python scripts/mutants/check.py "$@"
