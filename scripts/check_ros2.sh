#!/usr/bin/env bash
# Everything that ROS 2's own tools (ros2, launch) do with the nodes, some 90 checks, a few minutes: scripts/check_ros2.sh
# takes the `ros2` that is first in PATH; where it is the stand-in, nothing is checked.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
real=$(command -v ros2 || true)
source scripts/env.sh
[[ -z $real ]] || PATH=$(dirname "$real"):$PATH
export ROS_DOMAIN_ID=${TRUNK_TEST_DOMAIN:-95} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST RCUTILS_COLORIZED_OUTPUT=0
exec python -m tests.ros2_tools.check
