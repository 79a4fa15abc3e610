#!/usr/bin/env bash
# Print the folder of the environment with requirements/release.txt (pip-audit, cyclonedx-py); make it if it is
# missing or old. It is separate from .venv: no run or test uses it.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
folder=$PWD/.venv/.release
if ! cmp -s requirements/release.txt "$folder/.installed"; then
    echo 'release_tools: installing requirements/release.txt' >&2
    rm -rf "$folder"
    .venv/bin/python -m venv "$folder"
    bash scripts/install.sh "$folder/bin/python" requirements/release.txt .venv/.release-log
    cp requirements/release.txt "$folder/.installed"
fi
printf '%s\n' "$folder"
