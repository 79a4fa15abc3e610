"""C compiled to WebAssembly by clang and lld: the system's, or those of PyPI's ziglang."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from ..errors import PlanError

_COMPILE = (
    *("-std=c99", "-O2", "-ffreestanding", "-fno-builtin", "-nostdlib"),
    *("-mbulk-memory", "-fvisibility=hidden"),
)
_LINK = ("-Wl,--no-entry", "-Wl,--strip-all", "-Wl,-z,stack-size=65536")
_TOOLS = ("clang", "wasm-ld")


def missing_tools() -> str:
    """Return why nothing can be compiled here, in one line; empty if it can."""
    missing = [name for name in _TOOLS if shutil.which(name) is None]
    if not missing or find_spec("ziglang"):
        return ""
    return (
        f"{' and '.join(missing)} not found: pip install -r requirements/lab.txt in the project's folder, "
        "which brings both, or install clang and lld"
    )


def _compiler() -> tuple[str, ...]:
    if all(map(shutil.which, _TOOLS)):
        return "clang", "--target=wasm32"
    return sys.executable, "-m", "ziglang", "cc", "--target=wasm32-freestanding"


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
        command = [*_compiler(), *_COMPILE, *_LINK, *names, str(source), "-o", str(module)]
        caches = dict.fromkeys(("ZIG_LOCAL_CACHE_DIR", "ZIG_GLOBAL_CACHE_DIR"), folder)
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env={**os.environ, **caches}
        )
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error:" in line]
            raise PlanError(f"clang: {(lines or [done.stderr.strip() or 'no reason given'])[0]}")
        return module.read_bytes()
