#!/usr/bin/env bash
# All checks, the same for a person and for CI: scripts/test.sh [pytest arguments]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null || { echo 'test: FAILED: bootstrap' >&2; exit 1; }
source scripts/env.sh
bash scripts/browser.sh >/dev/null || true # says why, and its tests are skipped

failed=()
stage() { # NAME COMMAND...
    printf '\n── %s\n' "$1"
    "${@:2}" || failed+=("$1")
}

syntax() {
    local script
    for script in scripts/*.sh scripts/standin/ros2 .ci/run; do bash -n "$script" || return; done
}

stage 'shell syntax' syntax
stage 'ruff check' ruff check
stage 'ruff format' ruff format --check
stage mypy mypy
stage arrows lint-imports
if (($#)); then
    stage pytest python -m pytest "$@"
else # what keeps time has all cores to itself; the rest shares them
    stage pytest python -m pytest -n auto --dist worksteal -m 'not (alone or browser)'
    stage 'pytest: what keeps time' python -m pytest -m 'alone or browser' --durations=8
fi

if ((${#failed[@]})); then
    printf '\ntest: FAILED:%s\n' "$(printf ' %s,' "${failed[@]}" | sed 's/,$//')" >&2
    exit 1
fi
printf '\ntest: all passed\n'
