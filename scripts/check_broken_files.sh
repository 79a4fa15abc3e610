#!/usr/bin/env bash
# A recording cut at a thousand places, and with a thousand bits flipped, some four minutes; scripts/test.sh
# tries each kind of place: scripts/check_broken_files.sh [pytest arguments]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
TRUNK_BROKEN=1000 exec python -m pytest ros2_ws/src/trunk_experiments/test/test_broken_files.py -k 'cuts or flipped' "$@"
