#!/usr/bin/env bash
# Some 150 hostile files, each read by every verb with 2 GB of memory and 30 s of the processor: no traceback, no
# time-out, no number that mcap and rosbags do not read too. Then how soon a signal ends each verb.
#   scripts/check_hostile.sh [words in the files' names]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
python -m tests.hostile.check "$@"
(($#)) || python -m tests.hostile.signals
