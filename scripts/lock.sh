#!/usr/bin/env bash
# Renew requirements/*.txt from requirements/*.in; needs uv (pip install uv). Further arguments go to
# uv, e.g. scripts/lock.sh --upgrade-package numpy
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../requirements"

# One version of a package for CPython 3.10 to 3.13 wherever there is one: same pins, same bits.
compile=(uv pip compile --quiet --universal --python-version 3.10 --fork-strategy fewest
         --no-config --no-emit-index-url --no-annotate --no-header)

all=$(mktemp --suffix=.txt)
trap 'rm -f "$all"' EXIT
sort -u {runtime,ros,build,cluster,dev}.txt >"$all" # uv keeps the pins it finds in its output file
"${compile[@]}" "$@" {runtime,ros,build,cluster,dev}.in -o "$all"
for set in runtime ros build cluster dev; do
    "${compile[@]}" --constraint "$all" "$set.in" -o "$set.txt"
done
"${compile[@]}" --no-deps "$@" bench.in -o bench.txt
sed -i '1i # pip install --no-deps -r requirements/bench.txt' bench.txt
"${compile[@]}" --no-deps "$@" fuzz.in -o fuzz.txt
sed -i '1i # pip install --no-deps -r requirements/fuzz.txt' fuzz.txt
