#!/usr/bin/env bash
# Every verb with each of some 230 bad arguments: typos, swapped files, wrong units, outputs in the wrong place. An
# error or a warning in one line, and nothing lost on disk.
#   scripts/check_bad_arguments.sh [--every N] [VERB...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
python -m tests.hostile.arguments "$@"
