#!/usr/bin/env bash
# Fetch again what is kept here of other projects: uPlot, the live page's charts. Needs curl and the network.
# To renew it: another version, and the sha512 that the npm registry gives for it (npm view uplot@VERSION dist.integrity).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
version=1.6.32
sha512=KIMVnG68zvu5XXUbC4LQEPnhwOxBuLyW1AHtpm6IKTXImkbLgkMy+jabjLgSLMasNuGGzQm/ep3tOkyTxpiQIw==
target=ros2_ws/src/trunk_experiments/trunk_experiments/gateway/page/vendor

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
curl --fail --silent --show-error --location -o "$folder/uplot.tgz" "https://registry.npmjs.org/uplot/-/uplot-$version.tgz"
found=$(openssl dgst -sha512 -binary "$folder/uplot.tgz" | base64 --wrap=0)
[[ $found == "$sha512" ]] || { echo "vendor: uplot-$version.tgz: sha512 is $found, not $sha512" >&2; exit 1; }
tar --extract --gzip --file "$folder/uplot.tgz" --directory "$folder"
cp "$folder"/package/dist/uPlot.iife.min.js "$folder"/package/dist/uPlot.min.css "$folder"/package/LICENSE "$target/"
