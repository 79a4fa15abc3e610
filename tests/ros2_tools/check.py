"""Whether ROS 2's own tools find everything as they expect it: one line for each check.

    source scripts/env.sh && python -m tests.ros2_tools.check

It needs the real `ros2` command, from apt or from an environment that has ros2cli, launch and launch_ros.
Nodes run in their own ROS domain, on this machine alone.
"""

import os
import sys
import tempfile
from pathlib import Path

from .launches import check_launch, check_swap
from .nodes import (
    check_as_in_ros2_control,
    check_lifecycle,
    check_packages,
    check_runs,
    check_topics,
)
from .tools import daemon_of_ours, results, ros2


def main() -> int:
    os.environ["ROS_DOMAIN_ID"] = os.environ.get("TRUNK_TEST_DOMAIN", "95")
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["RCUTILS_COLORIZED_OUTPUT"] = "0"
    if ros2("service", "list", "--help").returncode:
        print("skipped: no real ros2 command here; source /opt/ros/jazzy/setup.bash first")
        return 0
    with tempfile.TemporaryDirectory() as name, daemon_of_ours():
        folder = Path(name)
        check_packages()
        check_runs(folder)
        check_topics(folder)
        check_lifecycle()
        check_as_in_ros2_control()
        check_launch(folder)
        check_swap(folder)
    failed = results.count(False)
    print(f"{len(results)} checks, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
