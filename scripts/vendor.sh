#!/usr/bin/env bash
# Fetch again the files of another project that are kept here: uPlot, for the charts of all pages. Needs npm, whose own
# settings name the registry, and the network. To update it, change its version and the sha512 that the registry gives
# for it (npm view uplot@VERSION dist.integrity).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../ros2_ws/src/trunk_views/trunk_views"

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

renew() { # NAME VERSION SHA512 TARGET FILE...: these files of the package
    local name=$1 version=$2 sha512=$3 target=$4 found
    npm pack --loglevel error --pack-destination "$folder" "$name@$version" >/dev/null
    found=$(openssl dgst -sha512 -binary "$folder/$name-$version.tgz" | base64 --wrap=0)
    [[ $found == "$sha512" ]] || { echo "vendor: $name-$version.tgz: sha512 is $found, not $sha512" >&2; exit 1; }
    mkdir "$folder/$name"
    tar --extract --gzip --file "$folder/$name-$version.tgz" --directory "$folder/$name" --strip-components 1
    (cd "$folder/$name" && cp "${@:5}" "$OLDPWD/$target/")
}

renew uplot 1.6.32 KIMVnG68zvu5XXUbC4LQEPnhwOxBuLyW1AHtpm6IKTXImkbLgkMy+jabjLgSLMasNuGGzQm/ep3tOkyTxpiQIw== \
    parts/vendor dist/uPlot.iife.min.js dist/uPlot.min.css LICENSE
