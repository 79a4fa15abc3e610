#!/usr/bin/env bash
# Renew requirements/*.txt from requirements/*.in: pins, and the hashes of all files that PyPI has of them. Needs uv
# (pip install uv) and the network. Pins stay as they are unless an option changes them: scripts/lock.sh --upgrade-package numpy
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../requirements"
sets=(setuptools runtime ros build cluster cyclonedds gym notebook lab dev release fuzz docs)

# Hashes are PyPI's: no other index, from an environment or from a file, takes part.
unset UV_INDEX UV_DEFAULT_INDEX UV_INDEX_URL UV_EXTRA_INDEX_URL UV_FIND_LINKS
# One version of a package for CPython 3.10 to 3.13 wherever there is one: same pins, same bits.
compile=(uv pip compile --quiet --universal --python-version 3.10 --fork-strategy fewest
         --no-config --no-emit-index-url --no-annotate --no-header)

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
pins() { sed -n '/==/{s/ *\\$//;p}' "$@" | sort -u; } # FILE...: as they are, without hashes

pins "${sets[@]/%/.txt}" >"$folder/all.txt" 2>/dev/null || true # uv keeps the pins it finds in its output file
"${compile[@]}" "$@" "${sets[@]/%/.in}" -o "$folder/all.txt"
# pyfuzzylite's bound on numpy is not ours: what benchmarks compare with is locked without dependencies.
pins bench.txt >"$folder/bench-pins.txt"
"${compile[@]}" --no-deps "$@" bench.in -o "$folder/bench-pins.txt"
# Into new files: uv would also keep the hashes that it finds, whatever they are.
for set in "${sets[@]}"; do
    "${compile[@]}" --generate-hashes --constraint "$folder/all.txt" "$set.in" -o "$folder/$set.txt"
done
for set in fuzzy bench; do
    "${compile[@]}" --generate-hashes --no-deps --constraint "$folder/bench-pins.txt" "$set.in" -o "$folder/$set.txt"
    sed -i "1i # pip install --no-deps -r requirements/$set.txt" "$folder/$set.txt"
done
for set in cuda12 cuda13; do # which exclude each other
    "${compile[@]}" --generate-hashes --constraint "$folder/all.txt" "$set.in" -o "$folder/$set.txt"
done
for set in "${sets[@]}" fuzzy bench cuda12 cuda13; do mv "$folder/$set.txt" "$set.txt"; done
