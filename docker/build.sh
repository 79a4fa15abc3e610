#!/usr/bin/env bash
# Build an image with the commit, the version and the address of its sources in it: docker/build.sh TARGET [OPTION ...]
# TARGET is slim, cluster or ros; the image is trunk:TARGET. What follows goes to `docker build`.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
[[ ${1:-} =~ ^(slim|cluster|ros)$ ]] || { echo "build: '${1:-}' is not a target: slim, cluster or ros" >&2; exit 2; }
commit=$(git describe --always --abbrev=40 --exclude='*' --dirty=+dirty 2>/dev/null) || commit=none
source=$(git remote get-url origin 2>/dev/null | sed 's|//[^/@]*@|//|') || source=''
exec docker build --file docker/Dockerfile --target "$1" --tag "trunk:$1" --build-arg "COMMIT=$commit" \
    --build-arg "SOURCE=${source:-none}" --build-arg "VERSION=$(bash scripts/version.sh)" "${@:2}" .
