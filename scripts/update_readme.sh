#!/usr/bin/env bash
# Make the generated tables anew: the README's from the declarations, docs/faults.md's from its tests.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
python -m trunk_experiments.readme README.md
python -m tests.faults.matrix docs/faults.md
