"""Read rule files of others and compare: check_rule_files.py FOLDER [TOLERANCE].

Each .fis, .fll and .fcl below FOLDER becomes a table, whatever its one or two inputs are called. The table
is compared at 10,000 points with pyfuzzylite and with the program `fuzzylite` (Debian's package), which reads
the file itself. Prints a Markdown table, deviations as shares of the outputs' spans. Exit code 1 if an exact
table is more than 1e-9 from either, or another more than TOLERANCE (0.01) or its own deviation.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from trunk_control.rulebase.importing import ALONE, TRANSLATIONS, read_fll
from trunk_control.rulebase.inference import RuleEngine
from trunk_control.rulebase.sampling import Sampling, check_points, sample
from trunk_core.errors import RuleFileError

POINTS = 10_000
ALIKE = 1e-9  # what an exact table and two programs may differ by
RESOLUTION = "1000"  # pyfuzzylite's where a .fll has none; the program's is 100


class Row(NamedTuple):
    """A file's line: the table's size, and the greatest deviations as shares of the outputs' spans."""

    sampling: Sampling
    from_library: float
    from_program: float  # NaN: it does not read the file
    between: float  # of the library from the program


def compared(path: Path, tolerance: float, folder: Path) -> Row:
    """Return how far a file's table is from both evaluations. Raises RuleFileError."""
    engine = RuleEngine(read_fll(path), path, both_ends=path.suffix.lower() == ".fis")
    if len(engine.inputs) > 2:
        raise RuleFileError(f"{len(engine.inputs)} inputs")
    ranges = [*map(engine.range, engine.inputs), ALONE][:2]
    bends = [*map(engine.vertices, engine.inputs), []][:2]

    def surface(*values: Any) -> Any:
        return engine.evaluate(dict(zip(engine.inputs, values, strict=False)), engine.outputs)

    engine.check_centroids(
        {name: engine.range(name) for name in engine.inputs}, engine.outputs, tolerance
    )
    sampling = sample(surface, check_points(surface, ranges), ranges, bends, tolerance)
    points = check_points(surface, ranges, count=POINTS)
    table = sampling.table.at(points.error, points.rate)
    at = np.stack([points.error, points.rate][: len(engine.inputs)])
    program = evaluated(path.read_text(encoding="utf-8", errors="replace"), path.suffix, at, folder)
    if program.shape != table.shape:  # it does not read the file itself: our translation
        program = evaluated(read_fll(path), ".fll", at, folder)
    if program.shape != table.shape:
        program = np.full(table.shape, np.nan)

    def share(a: Any, b: Any) -> float:
        return float(np.max(np.abs(a - b) / points.span[:, None]))

    return Row(
        sampling, share(table, points.values), share(table, program), share(points.values, program)
    )


def evaluated(text: str, suffix: str, points: Any, folder: Path) -> Any:
    """Return the outputs (rows) that the program computes for a file's text at points (columns)."""
    suffix = suffix.lower()[1:]
    file, at, out = (folder / name for name in (f"rules.{suffix}", "at.fld", "out.fld"))
    out.unlink(missing_ok=True)
    if suffix == "fll":
        shapes = "Centroid|Bisector|(?:Smallest|Mean|Largest)OfMaximum"
        text = re.sub(
            rf"(defuzzifier: (?:{shapes}))[ \t]*$", rf"\1 {RESOLUTION}", text, flags=re.MULTILINE
        )
    file.write_text(text, encoding="utf-8")
    np.savetxt(at, points.T, fmt="%.17g")
    command = ["fuzzylite", "-i", file, "-if", suffix, "-o", out, "-of", "fld", "-d", at]
    command += ["-decimals", "17", "-dheader", "false", "-dinputs", "false"]
    done = subprocess.run(command, capture_output=True, check=False, timeout=300)
    if done.returncode or not out.exists():
        return np.empty(0)
    return np.genfromtxt(out, ndmin=2).T


def main(arguments: list[str]) -> int:
    if not 1 <= len(arguments) <= 2 or shutil.which("fuzzylite") is None:
        print("check_rule_files: give a folder; needs Debian's package fuzzylite", file=sys.stderr)
        return 2
    tolerance = float(arguments[1]) if len(arguments) > 1 else 0.01
    wrong = 0
    print("| file | table | from pyfuzzylite | from fuzzylite | pyfuzzylite from fuzzylite |")
    print("|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        for path in sorted(Path(arguments[0]).rglob("*")):
            if path.suffix.lower() not in TRANSLATIONS:
                continue
            name = path.relative_to(arguments[0])
            try:
                row = compared(path, tolerance, Path(folder))
            except RuleFileError as error:
                print(f"| {name} | refused: {str(error).removeprefix(f'{path}: ')} | | | |")
                continue
            closest = 1.05 * row.sampling.deviation.share  # trunk rules read refuses it below that
            limit = ALIKE if row.sampling.exact else max(tolerance, closest)
            far = max(row.from_library, row.from_program) > limit
            wrong += far
            sizes = " x ".join(map(str, row.sampling.table.values.shape[1:]))
            kind = "exact" if row.sampling.exact else "sampled"
            kind = kind if closest <= 1.05 * tolerance else "no closer"
            numbers = (f"{x:.2g}" for x in row[1:])
            print(
                f"| {name} | {sizes} {kind} | {' | '.join(numbers)} |{' TOO FAR' if far else ''}",
                flush=True,
            )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
