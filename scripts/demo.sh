#!/usr/bin/env bash
# Ten seconds of the trunk under fuzzy-PID control, from a fresh checkout to a verdict.
exec bash "$(dirname "${BASH_SOURCE[0]}")/run.sh" demo --controller fuzzy_pid --duration 10 "$@"
