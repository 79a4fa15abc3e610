#!/usr/bin/env bash
# Write the bill of materials of what runs, as CycloneDX 1.6: scripts/sbom.sh FILE, e.g. trunk-0.1.0.cdx.json
# It goes beside a release. It holds no random number, and no time unless SOURCE_DATE_EPOCH gives it.
set -euo pipefail
die() { printf 'sbom: %s\n' "$*" >&2; exit 1; }
(($# == 1)) && [[ $1 == *.json ]] || die 'one argument is needed, the file to write, *.json'
[[ -d $(dirname "$1") ]] || die "$1: its folder does not exist"
target=$(realpath "$1")
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
tools=$(bash scripts/release_tools.sh)
[[ $(<.venv/.made) == wheels\ * ]] || die 'it is made from the pinned wheels: use a checkout without ROS 2 from apt'

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$tools/bin/cyclonedx-py" environment --sv 1.6 --output-reproducible .venv/bin/python -o "$folder/environment.json"
.venv/bin/python scripts/sbom.py "$folder/environment.json" >"$folder/sbom.json"
"$tools/bin/python" - "$folder/sbom.json" <<'PY' || die 'is not valid, see above; nothing was written'
import sys
from pathlib import Path

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(Path(sys.argv[1]).read_text("utf-8"))
if error is not None:
    sys.exit(f"sbom: {error!r:.300}")
PY
mv "$folder/sbom.json" "$target"
printf 'sbom: %s, valid CycloneDX 1.6\n' "$1"
