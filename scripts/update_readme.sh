#!/usr/bin/env bash
# Regenerate the tables: from the declarations, the library's reference, and the table of docs/faults.md from its tests.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
python -m trunk_experiments.readme docs/parameter_tables.md docs/api.md
python -m tests.faults.matrix docs/faults.md
