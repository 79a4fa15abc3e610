#!/usr/bin/env bash
# Run a scenario as ROS 2 nodes: scripts/run.sh SCENARIO --controller NAME … (see: scripts/run.sh --help)
set -euo pipefail
# A background job begins with SIGINT ignored, and a shell that does cannot handle it: it begins again without.
# Told to end while a command runs, a shell waits for it, and goes on unless it has a trap.
[[ -z $(trap -p INT) ]] || exec env --default-signal=INT bash "$0" "$@"
trap 'exit 130' INT
scripts=$(dirname "${BASH_SOURCE[0]}")
if [[ " $* " == *' --help '* || " $* " == *' -h '* ]] && [[ ! -e $scripts/../ros2_ws/install/.built ]]; then
    cat <<'END'
usage: scripts/run.sh SCENARIO --controller NAME [OPTION ...]

Sets up what is missing (once: 2 to 10 minutes, 410 MB to download, 1.5 GB in .venv), then runs `trunk run` with
these arguments. Scenarios: fig6, fig7, fig8, fig9, demo, cart_pole, or a parameter file's path. For all options, after
scripts/bootstrap.sh: scripts/run.sh --help
END
    exit
fi
bash "$scripts/bootstrap.sh" >/dev/null
# shellcheck source=scripts/env.sh
source "$scripts/env.sh"
exec trunk run "$@"
