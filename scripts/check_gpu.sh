#!/usr/bin/env bash
# On a machine with a card of NVIDIA's: random studies on it and in lanes, bit by bit; then the seconds of a million
# runs, and a benchmark. scripts/check_gpu.sh [STUDIES] [RUNS]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
# CUDA 13 needs driver 580 and compute capability 7.5.
IFS=', ' read -r driver capability < <(nvidia-smi --query-gpu=driver_version,compute_cap --format=csv,noheader -i 0)
version=12
((${driver%%.*} < 580 || ${capability/./} < 75)) || version=13
log=$(mktemp)
trap 'rm -f "$log"' EXIT
bash scripts/install.sh python "requirements/cuda$version.txt" "$log"
python -m tests.gpu.check "$@"
python -m benchmarks gpu --rounds 3
