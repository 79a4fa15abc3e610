#!/usr/bin/env bash
# Answer random states by exported controllers on every compiler and processor that there is, and compare each bit
# with CPython's; then run random plans through the closed loop in C. scripts/arm_tools.sh installs the rest.
#
#     scripts/check_export.sh [STATES [PLANS]]     default 100000 and 200; exit code 1 if a bit differs
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/env.sh
source scripts/env.sh
exec python -m tests.exported.check "$@"
