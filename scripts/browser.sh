#!/usr/bin/env bash
# Print the Chromium that the browser tests drive. If there is none, install Debian's as root;
# otherwise say why there is none and fail: those tests are then skipped.
set -euo pipefail

find_browser() {
    local name path
    for name in ${TRUNK_CHROMIUM:+"$TRUNK_CHROMIUM"} chromium chromium-browser google-chrome; do
        path=$(command -v "$name") || continue
        # Ubuntu's chromium-browser only points at a snap; where that is missing it does not run.
        "$path" --version >/dev/null 2>&1 || continue
        printf '%s\n' "$path"
        return
    done
    return 1
}

none() { printf 'browser: no Chromium (%s): browser tests are skipped\n' "$1" >&2; exit 1; }

find_browser && exit
[[ $(id -u) == 0 ]] || none 'not root; as root: apt-get install chromium'
command -v apt-get >/dev/null || none 'no apt-get here; install one, or name it in TRUNK_CHROMIUM'
echo 'browser: installing chromium' >&2
export DEBIAN_FRONTEND=noninteractive
{ apt-get -qq update && apt-get -qq install --yes --no-install-recommends chromium; } >/dev/null 2>&1 || true
find_browser || none 'apt-get install chromium failed; is the network up?'
