"""An exported law's update against the same law by hand in C: time per update, both in one program.

The program first asserts that both give the same commands, bit by bit.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from trunk_control.laws import law_named
from trunk_experiments.errors import NotInstalledError
from trunk_experiments.export_c.controller import ExportedController
from trunk_experiments.export_c.files import header, source

from .harness import Row

LAWS = ("pid", "fuzzy_pid")
GOAL = 1.3  # at most: our time to theirs
_NAMES = {
    "SAMPLE": "Sample",
    "CONTROLLER": "Controller",
    "TERMS": "Terms",
    "RESET": "reset",
    "UPDATE": "update",
}
_TABLES = {
    "ERROR_PEAKS": "error_peaks",
    "RATE_PEAKS": "rate_peaks",
    "KP": "kp",
    "KD": "kd",
    "ALPHA": "alpha",
}


def compare(rounds: int = 7) -> list[Row]:
    """Compare an exported law's update with the same law by hand in C; the bits must be equal."""
    compiler = os.environ.get("CC") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise NotInstalledError("the benchmark export needs a C compiler: apt-get install gcc")
    return [_row(name, compiler, rounds) for name in LAWS]


def _row(name: str, compiler: str, rounds: int) -> Row:
    law = law_named(name)
    exported = ExportedController(law, law.config(), bare=True)
    with tempfile.TemporaryDirectory(prefix="trunk-bench-") as place:
        folder = Path(place)
        (folder / f"{name}.h").write_text(header(exported))
        (folder / f"{name}.c").write_text(source(exported))
        (folder / "law.h").write_text(_glue(name))
        for own in ("by_hand.c", "exported.c"):
            shutil.copy(Path(__file__).with_name(own), folder)
        words = [compiler, "-std=c99", "-O2", "exported.c", "-o", "bench"]
        subprocess.run(words, cwd=folder, check=True)
        out = subprocess.run(
            ["./bench", str(rounds)], cwd=folder, capture_output=True, text=True, check=True
        ).stdout
    rounds_s = [[1e-9 * float(ns) for ns in line.split()] for line in out.splitlines()]
    ours, theirs = zip(*rounds_s, strict=True)
    return Row.of(f"{law.label}, exported / by hand", ours, theirs, "ns", at_most=GOAL)


def _glue(name: str) -> str:
    """Return the header that gives the program the law under names of its own."""
    lines = ["#define _POSIX_C_SOURCE 199309L", f'#include "{name}.c"']
    lines += [f"#define LAW_{own} {name}_{theirs}" for own, theirs in _NAMES.items()]
    if name == "fuzzy_pid":
        lines += ["#define FUZZY"]
        lines += [f"#define {own} (INITIAL.constants.item0.{t})" for own, t in _TABLES.items()]
    return "\n".join(lines) + "\n"
