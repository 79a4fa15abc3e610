#!/usr/bin/env bash
# Make the README's tables anew from the declarations of parameters and topics.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
python -m trunk_experiments.readme README.md
