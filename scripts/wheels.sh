#!/usr/bin/env bash
# Build the wheels of the packages, for the verbs that need no ROS: scripts/wheels.sh FOLDER (docs/maintaining.md)
# Needs no network. The same sources give the same bytes; SOURCE_DATE_EPOCH gives their time, 1980 unless it is set.
set -euo pipefail
die() { printf 'wheels: %s\n' "$*" >&2; exit 1; }
(($# == 1)) && [[ $1 != -* ]] || die 'one argument is needed, the folder for the wheels'
mkdir -p "$1" 2>/dev/null && [[ -w $1 ]] || die "$1: not a writable folder: give another"
target=$(realpath "$1")
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
[[ -z $(find "$target" -maxdepth 1 -name 'trunk_*.whl' -print -quit) ]] ||
    die "$1: already holds wheels of the project: give another folder, or delete them"
python=$PWD/.venv/bin/python
[[ -e .venv/.installed ]] || die 'not set up yet: run scripts/bootstrap.sh'

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# Copies: setuptools leaves its work beside what it builds. What was not built has no data of an earlier build in it.
for package in ros2_ws/src/*/; do
    name=$(basename "$package")
    cp -r "$package" "$folder/$name"
    cp LICENSE "$folder/$name/"
    rm -rf "$folder/$name/test"
    find "$folder/$name" \( -name __pycache__ -o -name '*.egg-info' -o -name build \) -prune -exec rm -rf {} +
done
# TRUNK_WHEEL: of the executables only `trunk`. `ros2 run` finds the nodes; in a bin/, `pid` would be anybody's.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-315532800} TRUNK_WHEEL=1 "$python" -m pip wheel --quiet --no-index --no-deps \
    --no-build-isolation --no-cache-dir --disable-pip-version-check --wheel-dir "$folder/wheels" "$folder"/trunk_* \
    >"$folder/log" 2>&1 || { cat "$folder/log" >&2; die 'could not be built, see above'; }
mv "$folder"/wheels/*.whl "$target"
for wheel in "$target"/trunk_*.whl; do printf 'wheels: %s\n' "$1/$(basename "$wheel")"; done
