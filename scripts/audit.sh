#!/usr/bin/env bash
# Look up known vulnerabilities of every version in requirements/*.txt: scripts/audit.sh [pip-audit's options]
# Exit code 0: all were looked up, none has any; 1: some have; 2: not everything could be looked up.
# Needs the network, so it is not part of scripts/test.sh.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
tools=$(bash scripts/release_tools.sh) || exit 2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

files=()
for file in requirements/*.txt; do files+=(--requirement "$file"); done
# --strict: what the service does not know must not pass for audited. No pip: the files name all there is.
code=0
"$tools/bin/pip-audit" --strict --disable-pip --require-hashes --progress-spinner off "${files[@]}" "$@" \
    2>"$folder/errors" || code=$?
if ((code == 1)) && ! grep -q '^Found ' "$folder/errors"; then
    reason=$(grep -m 1 'ERROR' "$folder/errors" || grep -v '^ *$' "$folder/errors" | tail -n 1)
    printf 'audit: not complete: %s; is the vulnerability service reachable?\n' "$(sed 's/.*ERROR:[^:]*://' <<<"$reason")" >&2
    exit 2
fi
cat "$folder/errors" >&2
exit "$code"
