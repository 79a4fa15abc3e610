#!/usr/bin/env bash
# Every case of docs/faults.md, about a quarter of an hour; scripts/test.sh runs a selection: scripts/check_faults.sh [pytest arguments]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
TRUNK_FAULTS=all exec python -m pytest tests/faults "$@"
