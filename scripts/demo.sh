#!/usr/bin/env bash
# Ten seconds of the trunk under fuzzy-PID control, from a fresh checkout to a verdict and a page: scripts/demo.sh [OPTION ...]
#
# In lock-step at the pace of real time, so that a busy machine gets the same run, only slower. The options are
# those of `trunk run`.
set -euo pipefail
scripts=$(dirname "${BASH_SOURCE[0]}")
if [[ " $* " == *' --help '* || " $* " == *' -h '* ]]; then
    exec bash "$scripts/run.sh" "$@"
fi
folder=runs/$(date -u +%Y%m%dT%H%M%SZ)_demo
for ((i = 1; i <= $#; i++)); do
    next=$((i + 1))
    case ${!i} in
        -o | --output) folder=${!next-} ;;
        --output=*) folder=${!i#*=} ;;
    esac
done
bash "$scripts/run.sh" demo --controller fuzzy_pid --duration 10 --lockstep --speed 1 --output "$folder" "$@"
# shellcheck source=scripts/env.sh
source "$scripts/env.sh"
report=$folder/report.html
[[ " $* " != *' --force '* ]] || rm -f "$report"
trunk verify "$folder"
trunk report "$folder" --output "$report" >/dev/null
page=$(python -c 'import pathlib, sys; print(pathlib.Path(sys.argv[1]).absolute().as_uri())' "$report")
printf '%s\n' "report: $page" '' 'Next, after: source scripts/env.sh'
printf '  %-80s # %s\n' \
    "trunk explain $folder --at 3.1" 'why this torque' \
    "trunk branch $folder --at 3 --controller pid -o what_if.mcap" 'what if PID had taken over' \
    "trunk live" 'push it yourself, in a browser'
