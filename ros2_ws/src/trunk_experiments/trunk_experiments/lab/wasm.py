"""C compiled to WebAssembly by clang and lld."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ..errors import PlanError

_COMPILE = (
    *("--target=wasm32", "-std=c99", "-O2", "-ffreestanding", "-fno-builtin", "-nostdlib"),
    *("-mbulk-memory", "-fvisibility=hidden"),
)
_LINK = ("-Wl,--no-entry", "-Wl,--strip-all", "-Wl,-z,stack-size=65536")


def missing_tools() -> str:
    """Return why nothing can be compiled here, in one line; empty if it can."""
    missing = [name for name in ("clang", "wasm-ld") if shutil.which(name) is None]
    if not missing:
        return ""
    return (
        f"{' and '.join(missing)} not found: install clang and lld, such as by scripts/arm_tools.sh"
    )


def wasm_of(text: str, exports: Sequence[str]) -> bytes:
    """Return a C text as a WebAssembly module without imports, which exports these functions and its memory.

    Raises PlanError where clang or lld is missing, or refuses the text.
    """
    if reason := missing_tools():
        raise PlanError(f"a lab needs WebAssembly: {reason}")
    with tempfile.TemporaryDirectory(prefix="trunk-lab-") as folder:
        source, module = Path(folder, "lab.c"), Path(folder, "lab.wasm")
        source.write_text(text)
        names = [f"-Wl,--export={name}" for name in exports]
        command = ["clang", *_COMPILE, *_LINK, *names, str(source), "-o", str(module)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error:" in line]
            raise PlanError(f"clang: {(lines or [done.stderr.strip() or 'no reason given'])[0]}")
        return module.read_bytes()
