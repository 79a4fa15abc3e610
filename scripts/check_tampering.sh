#!/usr/bin/env bash
# Every edit that we know of on three recordings, then 500 honest runs, half an hour; scripts/test.sh tries a
# selection: scripts/check_tampering.sh [edits | honest [N]]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
exec python -m tests.tampering.check "$@"
