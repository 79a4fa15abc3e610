#!/usr/bin/env bash
# Install one requirement file exactly as it is locked: scripts/install.sh PYTHON FILE LOG [pip's options]
# Installs nothing without a hash in FILE, no other dependencies, and runs no package's build code, except the one below.
# One line says what is wrong; pip's output is in LOG: a line 'Collecting …' for each package.
set -euo pipefail
python=$1 file=$2 log=$3
shift 3

# PyPI has no wheel of this one: setup.py is run by the setuptools of PYTHON (requirements/setuptools.txt). pip would
# otherwise download whatever setuptools is the newest, without a hash.
no_wheel=empy

"$python" -m pip install --no-input --disable-pip-version-check --require-hashes --no-deps \
    --only-binary :all: --no-binary "$no_wheel" --no-build-isolation "$@" -r "$file" >"$log" 2>&1 && exit

fail() { printf '%s: %s\n' "$file" "$*" >&2; exit 1; }
named() { grep -m 1 -A 9 "$1" "$log" | grep -m 1 -oE '[A-Za-z0-9._-]+==[^ ]+' || echo 'a package'; }

grep -q 'DO NOT MATCH THE HASHES' "$log" &&
    fail "$(named 'DO NOT MATCH THE HASHES'): what was downloaded has none of the hashes in this file, so it was not" \
        "installed: this file or the download was altered. After an edit by hand, run scripts/lock.sh"
grep -q 'Hashes are required' "$log" &&
    fail "$(named 'Hashes are required'): this file has no hash for it, so it was not installed: run scripts/lock.sh"
fail "could not be installed: $(grep -m 1 '^ERROR' "$log" || tail -n 1 "$log"); is the network up?" \
    "Just run this again (pip's output is in $log)"
