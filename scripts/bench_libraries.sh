#!/usr/bin/env bash
# The tests of the benchmarks against other libraries (MuJoCo, pyfuzzylite, scikit-fuzzy): installs the
# libraries beside .venv's, not into it, and runs the tests: scripts/bench_libraries.sh [pytest arguments]
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
folder=$PWD/.venv/.bench
if ! cmp -s requirements/bench.txt "$folder/.installed"; then
    rm -rf "$folder"
    bash scripts/install.sh python requirements/bench.txt .venv/.bench-log --target "$folder"
    cp requirements/bench.txt "$folder/.installed"
fi
PYTHONPATH=$folder:${PYTHONPATH:-} exec python -m pytest tests/test_benchmarks.py "$@"
