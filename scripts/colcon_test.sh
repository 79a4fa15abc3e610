#!/usr/bin/env bash
# `colcon test` and `colcon test-result` over all packages; arguments go to pytest: scripts/colcon_test.sh -m 'not slow'
# Each package's tests find the packages below it alone. Fails, unlike colcon, where a package's pytest ran no test at all.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source scripts/env.sh
cd ros2_ws
export COLCON_HOME=$VIRTUAL_ENV/.colcon TRUNK_BELOW=1

args=()
for arg in "$@"; do args+=(" $arg"); done # colcon takes "-m" for itself without the space before it
rm -f build/*/pytest.xml
python -m colcon --log-base /dev/null test --event-handlers console_direct- console_cohesion- \
    --return-code-on-test-failure ${args[@]:+--pytest-args "${args[@]}"} || failed=1
python -m colcon --log-base /dev/null test-result --verbose || failed=1
for package in src/*/; do
    report=build/$(basename "$package")/pytest.xml
    if ! grep -q '<testcase ' "$report" 2>/dev/null; then
        echo "colcon_test: FAILED: no test of $(basename "$package") was run" >&2
        failed=1
    fi
done
exit "${failed:-0}"
