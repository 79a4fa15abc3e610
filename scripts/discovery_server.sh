#!/usr/bin/env bash
# A Fast DDS discovery server: scripts/discovery_server.sh [-l ADDRESS] [-p PORT], by default every address, 11811.
# Nodes find it with ROS_DISCOVERY_SERVER=HOST:11811 (docs/hosts.md).
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/env.sh"
# Through Python, which knows where the wheels' libraries are; with ROS 2 installed it makes no difference.
exec python3 -c '
import os, shutil, sys
server = shutil.which("fast-discovery-server") or sys.exit("no fast-discovery-server: is Fast DDS installed?")
os.execv(server, [server, "-i", "0", *sys.argv[1:]])' "$@"
