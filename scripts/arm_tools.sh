#!/usr/bin/env bash
# Install from Debian or Ubuntu what builds and runs C for Arm: cross-compilers, newlib, QEMU; also clang and lld.
# For docs/export_c.md and python -m tests.exported.check; needs root.
set -euo pipefail
packages=(
    gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm   # Cortex-M4, Cortex-M7
    gcc-arm-linux-gnueabihf libc6-dev-armhf-cross qemu-user     # 32-bit Arm under Linux
    clang lld                                                   # also WebAssembly
)
if ! command -v apt-get >/dev/null; then
    echo "arm_tools: no apt-get here: install ${packages[*]} by your system's means" >&2
    exit 1
fi
sudo=()
if [ "$(id -u)" != 0 ]; then sudo=(sudo); fi
"${sudo[@]}" apt-get update -qq
DEBIAN_FRONTEND=noninteractive "${sudo[@]}" apt-get install -y -qq --no-install-recommends "${packages[@]}"
