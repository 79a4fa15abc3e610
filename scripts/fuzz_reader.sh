#!/usr/bin/env bash
# Coverage-guided fuzzing of the reader with atheris, beside .venv's libraries: scripts/fuzz_reader.sh [MINUTES [FOLDER]]
# begins with tests/corpus.zip and a short run; FOLDER (build/fuzz) keeps what it finds. Without a finding,
# python -m tests.hostile.corpus FOLDER makes the corpus that CI replays anew.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
minutes=${1:-10}
folder=$(realpath -m "${2:-build/fuzz}")
libraries=$PWD/.venv/.fuzz
if ! cmp -s requirements/fuzz.txt "$libraries/.installed"; then
    rm -rf "$libraries"
    python -m pip install --quiet --disable-pip-version-check --no-deps --target "$libraries" -r requirements/fuzz.txt
    cp requirements/fuzz.txt "$libraries/.installed"
fi
mkdir -p "$folder/corpus" "$folder/findings"
python -m tests.hostile.seeds "$folder/seeds"
python -m zipfile -e tests/corpus.zip "$folder/seeds" 2>/dev/null || true
PYTHONPATH=$PWD:$libraries:${PYTHONPATH:-} exec nice -n 5 python -m tests.hostile.fuzz \
    "$folder/corpus" "$folder/seeds" -max_total_time=$((60 * minutes)) -timeout=30 -rss_limit_mb=2048 \
    -max_len=40000 -artifact_prefix="$folder/findings/"
