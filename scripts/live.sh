#!/usr/bin/env bash
# Run a scenario as ROS 2 nodes, in a browser: scripts/live.sh [SCENARIO] --controller NAME … (see: scripts/live.sh --help)
set -euo pipefail
scripts=$(dirname "${BASH_SOURCE[0]}")
bash "$scripts/bootstrap.sh" >/dev/null
# shellcheck source=scripts/env.sh
source "$scripts/env.sh"
exec trunk live "$@"
