#!/usr/bin/env bash
# Coverage-guided fuzzing of the reader with atheris, beside .venv's libraries: scripts/fuzz_reader.sh [MINUTES [FOLDER]]
# begins with tests/corpus.tar.xz and a short run; FOLDER (runs/fuzz) keeps what it finds. If it finds nothing,
# python -m tests.hostile.corpus FOLDER/corpus rebuilds the corpus that CI replays.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
minutes=${1:-10}
folder=$(realpath -m "${2:-runs/fuzz}")
libraries=$PWD/.venv/.fuzz
if ! cmp -s requirements/fuzz.txt "$libraries/.installed"; then
    rm -rf "$libraries"
    bash scripts/install.sh python requirements/fuzz.txt .venv/.fuzz-log --target "$libraries"
    cp requirements/fuzz.txt "$libraries/.installed"
fi
mkdir -p "$folder/corpus" "$folder/findings"
python -m tests.hostile.seeds "$folder/seeds"
tar -xf tests/corpus.tar.xz -C "$folder/seeds"
PYTHONPATH=$PWD:$libraries:${PYTHONPATH:-} exec nice -n 5 python -m tests.hostile.fuzz \
    "$folder/corpus" "$folder/seeds" -max_total_time=$((60 * minutes)) -timeout=30 -rss_limit_mb=2048 \
    -max_len=40000 -artifact_prefix="$folder/findings/"
