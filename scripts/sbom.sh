#!/usr/bin/env bash
# Write the bill of materials of what runs, as CycloneDX 1.6: scripts/sbom.sh FILE, e.g. trunk-0.1.0.cdx.json
# It goes beside a release. It holds no random number, and no time unless SOURCE_DATE_EPOCH gives it.
set -euo pipefail
die() { printf 'sbom: %s\n' "$*" >&2; exit 1; }
(($# == 1)) && [[ $1 == *.json ]] || die 'one argument is needed, the file to write, *.json'
[[ -d $(dirname "$1") ]] || die "$1: its folder does not exist"
target=$(realpath "$1")
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
tools=$(bash scripts/release_tools.sh)
sed -e :a -e '/\\$/{N;s/ *\\\n */ /;ba}' requirements/{runtime,ros}.txt | sort -u | # what both have: once
    "$tools/bin/cyclonedx-py" requirements --sv 1.6 --validate --output-reproducible -o "$target" -
printf 'sbom: %s, valid CycloneDX 1.6\n' "$1"
