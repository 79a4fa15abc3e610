#!/usr/bin/env bash
# Make .venv and build ros2_ws, or bring both up to date. Takes no time when nothing has changed; may be
# interrupted, run again, and run twice at once.
#
# Without ROS 2, Jazzy comes from pinned wheels. If a ROS 2 Jazzy is sourced, it is used and .venv
# only adds to it. Every file that is installed has its hash in requirements/. $PYTHON chooses the
# interpreter, CPython 3.10 to 3.13. For an image: --no-dev leaves out what only the tests need, and with --no-build
# after it .venv alone is made, which needs no sources.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD

say() { printf 'bootstrap: %s\n' "$*" >&2; }
die() { say "$@"; exit 1; }
holds() { [[ -f $1 && $(<"$1") == "$2" ]]; } # FILE TEXT

# What an interpreter is: "cpython 3.11.7 /usr/bin/python3.11".
identify() {
    "$1" -ISc 'import os, sys; i = sys.implementation.name, "%d.%d.%d" % sys.version_info[:3]
print(*i, os.path.realpath(sys.executable))' 2>/dev/null
}

supported() { [[ $1 == 'cpython 3.1'[0-3].* ]]; }

find_python() {
    local name found
    if [[ -n ${PYTHON:-} ]]; then
        found=$(identify "$PYTHON") || die "PYTHON=$PYTHON does not run"
        supported "$found" || die "PYTHON=$PYTHON is $found, CPython 3.10 to 3.13 is needed"
        [[ $ros == wheels ]] || "$PYTHON" -c 'import rclpy' 2>/dev/null ||
            die "ROS 2 Jazzy is sourced, but PYTHON=$PYTHON cannot import its rclpy: unset PYTHON"
        printf '%s\n' "$found"
        return
    fi
    for name in python3 python3.13 python3.12 python3.11 python3.10 /usr/bin/python3; do
        found=$(identify "$name") || continue
        supported "$found" || continue
        [[ $ros == wheels ]] || "$name" -c 'import rclpy' 2>/dev/null || continue
        printf '%s\n' "$found"
        return
    done
    [[ $ros == wheels ]] || die "ROS_DISTRO=jazzy, but no Python here imports rclpy: source" \
        "/opt/ros/jazzy/setup.bash, or unset ROS_DISTRO to use wheels"
    die "no CPython 3.10 to 3.13 found (python3, python3.13 … python3.10): install one, or name one in PYTHON"
}

# The build links to modules and data instead of copying them: only these trigger a rebuild.
workspace_key() {
    local src=ros2_ws/src
    { printf '%s\n' "$made" "$pins" "$(declare -f launcher)" $src/*/*/config/* $src/*/{launch,layouts,rviz}/*; cat $src/*/{package.xml,setup.py,setup.cfg}; } | sha256sum
}

up_to_date() {
    [[ ! -e .venv/.busy ]] && holds .venv/.made "$made" && holds .venv/.installed "$pins" &&
        built
}
built() { [[ $build == no ]] || holds ros2_ws/install/.built "$(workspace_key)"; }

make_venv() {
    "${python#cpython * }" -Ic 'import ensurepip, venv' 2>/dev/null || die "${python#cpython * } has no venv module:" \
        "install it (Debian, Ubuntu: apt install python3-venv) and run this again"
    say "making .venv with $python"
    # The build holds absolute paths and the interpreter's: it goes as well.
    rm -rf ros2_ws/build ros2_ws/install
    find .venv -mindepth 1 -maxdepth 1 ! -name .lock -exec rm -rf {} +
    local site=()
    [[ $ros == wheels ]] || site=(--system-site-packages)
    "${python#cpython * }" -m venv "${site[@]}" .venv >.venv/.log 2>&1 ||
        die "no virtual environment could be made; the reason is in .venv/.log"
    ln -s ../../ros2_ws/install/trunk_experiments/lib/trunk_experiments/trunk .venv/bin/trunk
    printf '%s\n' "$made" >.venv/.made
}

# How far pip is with a requirement file, by its log: one line, written anew until this script kills it or ends.
show_progress() { # FILE
    local begun of
    of=$(grep -c '^[^ #].*==' "$1")
    while kill -0 $$ 2>/dev/null; do
        begun=$(grep -c '^Collecting ' .venv/.log 2>/dev/null) || true
        printf '\rbootstrap: %s: %d of %d packages %s' "$1" "${begun:-0}" "$of" \
            "$(grep -q '^Installing ' .venv/.log 2>/dev/null && echo downloaded, unpacking)" >&2
        sleep 0.5
    done
}

install_set() {
    local pins=requirements/$1.txt wrong watch='' code=0
    say "installing $pins ($2)"
    if [[ $ros == jazzy ]]; then # its messages are compiled for its own numpy
        pins=.venv/.pins-$1.txt
        sed '/^numpy==/,/[^\\]$/d' "requirements/$1.txt" >"$pins" # up to the last of its hashes
    fi
    : >.venv/.log
    if [[ -t 2 ]]; then
        show_progress "$pins" 9>&- &
        watch=$!
    fi
    wrong=$(bash scripts/install.sh .venv/bin/python "$pins" .venv/.log "$compile" 2>&1) || code=$?
    if [[ $watch ]]; then
        kill "$watch" && wait "$watch" || true
        printf '\r\033[K' >&2
    fi
    ((code)) || return 0
    rm -f .venv/.busy # pip ended by itself: what it did is whole
    die "$wrong"
}

install_pins() {
    local set number=0 sets=(setuptools runtime ros build "${dev[@]}")
    if [[ $ros == jazzy ]]; then
        sets=(runtime "${dev[@]}")
        .venv/bin/python -c 'import colcon, colcon_ros' 2>/dev/null || sets+=(setuptools build)
    fi
    rm -f .venv/.installed
    : >.venv/.busy # stays when we are killed: .venv is then not trusted again
    for set in "${sets[@]}"; do install_set "$set" "$((++number)) of ${#sets[@]}"; done
    printf '%s\n' "$pins" >.venv/.installed
    rm .venv/.busy
}

# What starts an executable. sh reads the first line: a kernel takes no spaces and no long path there. SIGINT and
# SIGTERM are blocked until the program can handle them: see early_signals.py. setuptools' own would look the
# function up among all that is installed, which takes as long as the rest of `trunk --help`.
launcher() { # PACKAGE NAME
    local target
    target=$(sed -n '/^\[console_scripts\]/,/^\[/s/^'"$2"' = //p' "ros2_ws/build/$1/$1.egg-info/entry_points.txt")
    [[ $target == *:* ]] || die "package $1 does not say what its executable $2 calls"
    cat <<END
#!/bin/sh
'''exec' $held"$venv_python" "\$0" "\$@"
' '''
import sys

from ${target%:*} import ${target#*:} as main

if __name__ == "__main__":
    sys.exit(main())
END
}

build() {
    say 'building ros2_ws'
    local key script text venv_python=$root/.venv/bin/python
    key=$(workspace_key)
    rm -f ros2_ws/install/.built
    find ros2_ws/{build,install} -xtype l -delete 2>/dev/null || true # colcon keeps links to data that is gone
    (
        cd ros2_ws
        COLCON_HOME=$root/.venv/.colcon "$venv_python" -m colcon --log-base /dev/null build --symlink-install \
            --event-handlers console_cohesion+ desktop_notification-
    ) >.venv/.log 2>&1 || { cat .venv/.log >&2; die 'ros2_ws could not be built, see above'; }
    local held=''
    if env --block-signal=INT,TERM true 2>/dev/null; then held='env --block-signal=INT,TERM '; fi
    for script in ros2_ws/install/*/lib/trunk_*/*; do
        grep -qs "^${script##*/} = " "ros2_ws/build/$(basename "${script%/*}")"/*.egg-info/entry_points.txt ||
            { rm "$script"; continue; } # of an earlier build
        text=$(launcher "$(basename "$(dirname "$script")")" "$(basename "$script")")
        printf '%s\n' "$text" >"$script"
    done
    printf '%s\n' "$key" >ros2_ws/install/.built
}

# ── which ROS 2, which Python ──────────────────────────────────────────────────────────────────────────
made=$(cat .venv/.made 2>/dev/null) || made=''
case ${ROS_DISTRO:-} in
    jazzy) ros=jazzy ;;
    '') ros=${made%% *} ros=${ros:-wheels} ;;
    *) die "ROS 2 ${ROS_DISTRO@Q} is sourced in this shell, but this project is for Jazzy: use a shell without it" ;;
esac
# What it costs, measured on x86-64 with CPython 3.11: the files of pip download, and du -s .venv.
build=yes
case $* in
    # Most modules are never imported; the others are compiled when they first are. In an image they cannot be.
    '') dev=(dev fuzzy) compile=--no-compile download='410 MB' disk='1.5 GB' ;;
    --no-dev | '--no-dev --no-build')
        dev=() compile=--compile download='290 MB' disk='1.1 GB'
        [[ $* == --no-dev ]] || build=no
        ;;
    *) die "unknown argument '$*': --no-dev is allowed, and --no-dev --no-build" ;;
esac
[[ -d requirements ]] || die "nothing is installed in an image ($root): run trunk and ros2, without scripts/"
pins=$(cd requirements && cat {setuptools,runtime,ros,build}.txt "${dev[@]/%/.txt}" | sha256sum)

python=$(identify .venv/bin/python) || python=''
if [[ -z $python || -n ${PYTHON:-} || $made != "$ros"\ * ]]; then python=$(find_python); fi
made="$ros $python $root"

if up_to_date; then
    echo 'ready: source scripts/env.sh'
    exit
fi
[[ $ros == wheels || -n ${ROS_DISTRO:-} ]] ||
    die '.venv was made for the ROS 2 Jazzy of this machine: source /opt/ros/jazzy/setup.bash first, or delete .venv'

# ── the work, by one process at a time ─────────────────────────────────────────────────────────────────
mkdir -p .venv ros2_ws 2>/dev/null && [[ -w .venv && -w ros2_ws ]] ||
    die "this checkout cannot be written to ($root), but .venv and the build go into it: give it write permission, or copy it"
exec 9>>.venv/.lock
flock -n 9 || { say 'waiting for another bootstrap of this checkout'; flock 9; }
trap 'exit 130' INT TERM HUP

if [[ $ros == wheels ]]; then
    unset PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
fi
if [[ -e .venv/.busy ]] || ! holds .venv/.installed "$pins"; then
    say "this downloads up to $download and takes up to $disk in .venv, and 2 to 10 minutes"
fi
if [[ -e .venv/.busy ]] || ! holds .venv/.made "$made"; then make_venv; fi
holds .venv/.installed "$pins" || install_pins
built || build
echo 'ready: source scripts/env.sh'
