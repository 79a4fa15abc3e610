# shellcheck shell=bash
# Source this from bash or zsh: .venv, the built packages, `trunk`, and `ros2` (a stand-in if there is none).

_trunk_env() { # FILE SHELL
    local root flags=$-
    root=$(cd -P "$(dirname "$1")/.." && pwd) || return
    if [ ! -e "$root/.venv/.installed" ] || [ ! -e "$root/ros2_ws/install/.built" ]; then
        echo "trunk: not set up yet (or interrupted): run scripts/bootstrap.sh" >&2
        return 1
    fi
    if [ -n "${ROS_DISTRO:-}" ] && ! grep -q "^$ROS_DISTRO " "$root/.venv/.made"; then
        echo "trunk: not set up for the ROS 2 $ROS_DISTRO of this shell: run scripts/bootstrap.sh" >&2
        return 1
    fi

    set +eu # the scripts below are not written for these, nor for spaces in their own path
    case $root in *[[:space:]]*) local IFS=$'\n' ;; esac
    # shellcheck source=/dev/null
    . "$root/.venv/bin/activate"
    # shellcheck source=/dev/null
    . "$root/ros2_ws/install/setup.$2"
    case $flags in *e*) set -e ;; esac
    case $flags in *u*) set -u ;; esac

    if [ -d "$VIRTUAL_ENV/share/ament_index" ]; then # the wheels do not say where they are
        case :$AMENT_PREFIX_PATH: in
            *":$VIRTUAL_ENV:"*) ;;
            *) export AMENT_PREFIX_PATH="$AMENT_PREFIX_PATH:$VIRTUAL_ENV" ;;
        esac
    fi
    export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
    # Last on the path, so that a real ros2 always wins.
    command -v ros2 >/dev/null || export PATH="$PATH:$root/scripts/standin"
}

if [ -n "${ZSH_VERSION:-}" ]; then
    eval '_trunk_env "${(%):-%x}" zsh'
elif [ -z "${BASH_VERSION:-}" ]; then
    echo "trunk: source scripts/env.sh from bash or zsh" >&2
    false
elif [ "${BASH_SOURCE[0]}" = "$0" ]; then
    echo "trunk: source this script: source scripts/env.sh" >&2
    false
else
    _trunk_env "${BASH_SOURCE[0]}" bash
fi
