#!/usr/bin/env bash
# The environment of both images; the command replaces this shell, so that signals reach it.
set -e
if [[ -e /opt/ros/jazzy/setup.bash ]]; then
    # shellcheck source=/dev/null
    source /opt/ros/jazzy/setup.bash
fi
# shellcheck source=scripts/env.sh
source "$(dirname "${BASH_SOURCE[0]}")/../scripts/env.sh"
exec "$@"
