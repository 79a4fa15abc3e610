#!/usr/bin/env bash
# Print the project's version, or set it: scripts/version.sh [VERSION]. It is kept in trunk_core's package.xml;
# this script also writes it to the other package.xml files and CITATION.cff, and a test compares them.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
die() { printf 'version: %s\n' "$*" >&2; exit 1; }
(($# <= 1)) || die 'at most one argument: the new version, such as 0.2.0'
if (($# == 1)); then
    [[ $1 =~ ^[0-9]+\.[0-9]+\.[0-9]+$ ]] || die "'$1' is not a version: three numbers are needed, such as 0.2.0"
    sed -i "0,/<version>.*<\/version>/s//<version>$1<\/version>/" ros2_ws/src/*/package.xml --separate
    sed -i "s/^version: .*/version: $1/; s/^date-released: .*/date-released: $(date -u +%F)/" CITATION.cff
fi
sed -n 's/.*<version>\(.*\)<\/version>.*/\1/p' ros2_ws/src/trunk_core/package.xml
