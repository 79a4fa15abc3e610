#!/usr/bin/env bash
# The same bits in other environments, a line for each: scripts/check_portable.sh [STEPS]     default 100000
# Other processors, C libraries, versions of CPython, languages and compilers; docs/lockstep.md has the table. What
# is not available here is skipped, with the reason. Other interpreters: PYTHONS="/path/to/python3.12 ..."
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
source scripts/env.sh
steps=${1:-100000}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0

equal() { printf 'equal    %s\n' "$1"; }
skipped() { printf 'skipped  %s: %s\n' "$1" "$2"; }
check() { # NAME EXPECTED FOUND
    if [[ $2 == "$3" ]]; then equal "$1"; else
        printf 'DIFFERS  %s: %s, here %s\n' "$1" "$3" "$2"
        failed=1
    fi
}
sources=$(python -c 'import sys; print(":".join(p for p in sys.path if "/ros2_ws/" in p))')
cores() { # COMMAND...: the cores' hashes by another interpreter
    PYTHONPATH=$sources:$PWD PYTHONDONTWRITEBYTECODE=1 "$@" -m tests.portable.cores "$steps" 2>"$work/error" ||
        tail -n 1 "$work/error"
}

here=$(python -m tests.portable.cores "$steps")
printf '%s\n%s steps here: %s\n' "$(python -VV | head -n 1), $(uname -m)" "$steps" "$here"

sines() { python -c 'import math; print(hash(tuple(math.sin(0.001 * k) for k in range(100_000))))'; }
[[ $(sines) != "$(GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4 sines)" ]] ||
    printf 'note     masking FMA has no effect here: the next two lines compare the same code\n'
# glibc without FMA: the cores, and whole recordings with noise, exp and log in them.
export GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4
check 'glibc, FMA and AVX2 masked: states, commands, noise, elementary' "$here" "$(cores python)"
unset GLIBC_TUNABLES
record() { # FILE
    trunk simulate fig6 --controller fuzzy_pid -o "$work/$1" --set simulator.duration=60.0 \
        --set simulator.sensor.position_noise=0.001 --set fuzzy_pid.fuzzy.consequents=log >/dev/null
}
record a.mcap
GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4 record b.mcap
if trunk diff "$work/a.mcap" "$work/b.mcap" >/dev/null && trunk verify "$work/b.mcap" >/dev/null; then
    equal 'glibc, FMA and AVX2 masked: a recording of 60 s, and verified'
else
    check 'glibc, FMA and AVX2 masked: a recording of 60 s' same other
fi

# Other versions of CPython, each with a NumPy of its own.
numpy=$(python -c 'import numpy; print(numpy.__version__)')
for python in ${PYTHONS:-python3.10 python3.11 python3.12 python3.13}; do
    name="$("$python" -V 2>&1 || true), NumPy $numpy"
    if ! "$python" -m venv "$work/venv" >/dev/null 2>&1; then
        skipped "$python" 'not found'
    elif ! "$work/venv/bin/pip" -q install "numpy==$numpy" >"$work/error" 2>&1; then
        skipped "$name" "$(tail -n 1 "$work/error")"
    else
        check "$name: states, commands, noise, elementary" "$here" "$(cores "$work/venv/bin/python")"
    fi
    rm -rf "$work/venv"
done

# Vectors of 2 and of 4 doubles, against the widest that this processor has.
if [[ $(uname -m) == x86_64 ]]; then
    lanes() { XDG_CACHE_HOME="$work/cache$1" NUMBA_CPU_NAME=$1 NUMBA_CPU_FEATURES= python -m tests.portable.lanes; }
    widest=$(XDG_CACHE_HOME="$work/cache" python -m tests.portable.lanes)
    check 'numba in lanes, 2 at a time (SSE2): states, torques, noise, metrics' "$widest" "$(lanes x86-64)"
    if grep -q avx2 /proc/cpuinfo; then
        check 'numba in lanes, 4 at a time (AVX2): states, torques, noise, metrics' "$widest" "$(lanes x86-64-v3)"
    fi
fi

# The elementary functions in other languages, translated from their source, on shared vectors.
python -m tests.portable.vectors "$work" "$steps"
vectors() { # NAME COMMAND...
    local told
    told=$("${@:2}" <"$work/vectors.txt" 2>&1) && equal "$1: $told" || check "$1" '0 differ' "$told"
}
if command -v node >/dev/null; then
    vectors "V8 (Node.js $(node --version)): sin, cos, exp, log" node "$work/vectors.js"
else
    skipped 'V8' 'no Node.js'
fi
if command -v gcc >/dev/null; then
    gcc -O3 -march=native -ffp-contract=off "$work/vectors.c" -o "$work/native" -lm
    vectors 'C (gcc -O3 -march=native -ffp-contract=off): sin, cos, exp, log' "$work/native"
fi

# Debian's packages of another kind, unpacked, not installed: musl, and CPython for arm64 with an emulator.
debian() { # ARCHITECTURE FOLDER PACKAGES...
    local state=$work/apt-$1
    mkdir -p "$state/lists/partial" "$state/cache/archives/partial" "$2"
    : >"$state/status"
    local apt=(apt-get -qq -o "APT::Architecture=$1" -o "APT::Architectures=$1" -o "Dir::State::lists=$state/lists"
        -o "Dir::State::status=$state/status" -o "Dir::Cache=$state/cache" -o Debug::NoLocking=1
        -o APT::Sandbox::User= -o Acquire::Languages=none)
    "${apt[@]}" update && "${apt[@]}" -y --no-install-recommends --download-only install "${@:3}" || return
    ln -sfn usr/lib "$2/lib" && mkdir -p "$2/usr/lib"
    for package in "$state"/cache/archives/*.deb; do
        dpkg-deb --fsys-tarfile "$package" | tar -x -C "$2" --keep-directory-symlink || return
    done
}
if ! command -v apt-get dpkg-deb gcc >/dev/null; then
    skipped 'musl and arm64' "Debian's apt and gcc are needed"
    exit $failed
fi
machine=$(dpkg --print-architecture)
if debian "$machine" "$work/musl" musl-dev >"$work/error" 2>&1; then
    lib=$(dirname "$(find "$work/musl" -name crt1.o | head -n 1)")
    gcc -static -nostdlib -nostdinc -isystem "$(find "$work/musl" -type d -path '*include/*-linux-musl' | head -n 1)" \
        -O2 -ffp-contract=off "$lib/crt1.o" "$lib/crti.o" "$work/vectors.c" "$lib/libc.a" \
        "$(gcc -print-libgcc-file-name)" "$lib/crtn.o" -o "$work/with_musl"
    vectors 'C with musl: sin, cos, exp, log' "$work/with_musl"
else
    skipped 'musl' "$(tail -n 1 "$work/error")"
fi
if [[ $machine == arm64 ]]; then
    skipped 'aarch64' 'this machine is one'
elif debian "$machine" "$work/qemu" qemu-user-static >"$work/error" 2>&1 &&
    debian arm64 "$work/arm64" python3-minimal python3-numpy >"$work/error" 2>&1; then
    arm=("$work/qemu/usr/bin/qemu-aarch64-static" -L "$work/arm64" -E "PYTHONHOME=$work/arm64/usr"
        -E "PYTHONPATH=$work/arm64/usr/lib/python3/dist-packages:$sources:$PWD" -E PYTHONDONTWRITEBYTECODE=1
        -E "LD_LIBRARY_PATH=$work/arm64/usr/lib/aarch64-linux-gnu/blas:$work/arm64/usr/lib/aarch64-linux-gnu/lapack"
        "$work/arm64/usr/bin/$(basename "$(readlink "$work/arm64/usr/bin/python3")")")
    name="aarch64 (qemu-user, Debian's $("${arm[@]}" -V), NumPy $("${arm[@]}" -c 'import numpy; print(numpy.__version__)'))"
    check "$name: states, commands, noise, elementary" "$here" "$("${arm[@]}" -m tests.portable.cores "$steps" 2>&1 | tail -n 1)"
else
    skipped 'aarch64' "$(tail -n 1 "$work/error")"
fi
exit $failed
