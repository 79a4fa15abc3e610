"""Run the tests of modules on each of their mutants and print what survived.

check.py [MODULE[:LINE,...]]...     run by scripts/check_mutants.sh in a copy of the tree, which it changes
"""

from __future__ import annotations

import sys
import time
from collections.abc import Container
from pathlib import Path

from modules import MODULES, Module
from mutation import mutants_of
from trial import passes

WANTED = 0.9  # of the mutants, killed


def check(name: str, module: Module, lines: Container[int] | None) -> bool:
    """Print what becomes of a module's mutants; return True where enough of them are killed.

    ``lines``: of these lines alone; None: of all. Raises SystemExit where the tests fail without a mutant.
    """
    file = Path(module.file)
    took = 0.0
    for _ in range(2):  # the second time as a mutant finds it, with the tests compiled
        begin = time.monotonic()
        if not passes(module.tests, 600.0):
            passes(module.tests, 600.0, quiet=False)
            sys.exit(f"{name}: its tests fail, or take more than 10 min, even without a mutant")
        took = time.monotonic() - begin
    for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*"):
        stale.unlink()  # two changes within a second may look alike to Python
    sys.dont_write_bytecode = True
    source = file.read_text()
    begin, count, survived = time.monotonic(), 0, 0
    for mutant in mutants_of(source, module.placeholders):
        if lines is not None and mutant.line not in lines:
            continue
        file.write_text(mutant.source)
        count += 1
        # A mutant that does not end in time is killed.
        if passes(module.tests, max(30.0, 4.0 * took)):
            survived += 1
            print(f"  {module.file}:{mutant.line}: {mutant.change}", flush=True)
    file.write_text(source)
    sys.dont_write_bytecode = False
    killed, took = count - survived, time.monotonic() - begin
    print(
        f"{name}: {count} mutants, {killed} killed, {survived} survived ({took:.0f} s)", flush=True
    )
    return killed >= WANTED * count


def main() -> int:
    wanted = {}
    for text in sys.argv[1:] or MODULES:
        name, _, lines = text.partition(":")
        if name not in MODULES:
            print(f"{name!r} is not a module: give one of {', '.join(MODULES)}", file=sys.stderr)
            return 2
        if lines and not all(line.isdecimal() for line in lines.split(",")):
            print(f"{text!r}: the lines must be numbers, as in {name}:12,40", file=sys.stderr)
            return 2
        wanted[name] = [int(line) for line in lines.split(",")] if lines else None
    short = [name for name, lines in wanted.items() if not check(name, MODULES[name], lines)]
    if short:
        print(f"less than {WANTED:.0%} killed: {', '.join(short)}")
    return 1 if short else 0


if __name__ == "__main__":
    sys.exit(main())
