"""Attacks on `trunk verify`, all of them, and honest runs: python -m tests.tampering.check [edits|honest] [N]

Exit code 1 if what verifies after an edit shows other things than its plan gives, `verify` raises, or an
honest run is accused.
"""

import os
import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import chain
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from ros2_ws.src.trunk_recording.test.mcap_files import (
    ANEW,
    KEPT,
    NONE,
    Content,
    content,
    write_file,
)

from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import RecordingError

from .bases import BASES, OFFLINE, make_base
from .edits import Edit, edits_of
from .honest import graph_runs, offline_runs
from .shown import shown_otherwise

DIGESTS = (KEPT, ANEW, NONE)
_PARTS = 8  # of each recording's edits, so that all cores have work
_DURATION_S = {OFFLINE: 0.12, "lockstep": 0.3, "real_time": 0.3}


class Outcome(NamedTuple):
    """What became of one edit."""

    base: str
    edit: Edit
    digests: str
    exit_code: int | None  # None: the edit changes nothing in this recording
    others: tuple[str, ...] = ()  # what is shown otherwise than its plan gives
    raised: str = ""

    @property
    def name(self) -> str:
        """Which edit of which recording."""
        return f"{self.base}: {self.edit.kind}: {self.edit.name}"

    @property
    def wrong(self) -> str:
        """What is wrong with the outcome; empty: nothing."""
        if self.raised:
            return f"verify raised {self.raised}"
        if self.exit_code != VERIFIED:
            return ""
        if self.digests != ANEW:
            return "verified"
        return ", ".join(self.others[:5])


def outcome(base: str, found: Content, edit: Edit, digests: str, folder: Path) -> Outcome:
    """Apply an edit to a copy, write it and let `verify` judge it."""
    edited = found.copy()
    done = edit.apply(edited)
    if done is False or edited == found:
        return Outcome(base, edit, digests, None)
    path = folder / "edited.mcap"
    try:
        write_file(edited, path, digests)
        run = RecordedRun.open(path, whole=True)
        code = verdict_on(run).exit_code
        others = shown_otherwise(run) if code == VERIFIED and digests == ANEW else ()
    except RecordingError as error:  # refused as a whole: another arithmetic
        return Outcome(base, edit, digests, error.exit_code)
    except Exception as error:  # whatever it is: that is what is looked for
        return Outcome(base, edit, digests, 1, (), f"{type(error).__name__}: {error}")
    return Outcome(base, edit, digests, code, tuple(others))


def outcomes(
    base: str,
    path: Path,
    folder: Path,
    digests: tuple[str, ...] = DIGESTS,
    chosen: Callable[[Edit], bool] = lambda _: True,
) -> Iterator[Outcome]:
    """Yield what becomes of every edit of a recording."""
    found = content(path)
    for edit in edits_of(found):
        if chosen(edit):
            for kind in digests:
                yield outcome(base, found, edit, kind, folder)


def sample(share: float, seed: int = 1) -> Callable[[Edit], bool]:
    """Return a choice of edits, the same each time: each sort once, and a share of the others."""
    rng = random.Random(seed)
    seen: set[tuple[str, str]] = set()

    def chosen(edit: Edit) -> bool:
        _, comma, what = edit.name.rpartition(", ")
        sort = edit.kind, what if comma else ""
        first = share and sort not in seen
        seen.add(sort)
        return bool(first) or rng.random() < share

    return chosen


class Row(Counter[str]):
    """Counts of one kind of edit."""


def _part(base: str, path: str, number: int) -> list[tuple[str, str, str, int | None, str]]:
    """Return what became of every eighth edit: digests, kind, name, exit code, what is wrong."""
    turn = iter(range(1_000_000))

    def mine(_: object) -> bool:
        return next(turn) % _PARTS == number

    with tempfile.TemporaryDirectory() as folder:
        return [
            (one.digests, one.edit.kind, one.name, one.exit_code, one.wrong)
            for one in outcomes(base, Path(path), Path(folder), DIGESTS, mine)
        ]


def check_edits(folder: Path) -> int:
    """Apply every edit to every base; print what is wrong, a table by kind and a line of totals."""
    for base in BASES:
        make_base(base, folder / f"{base}.mcap", _DURATION_S[base])
    rows: dict[str, Row] = {}
    wrong = []
    jobs = [(base, str(folder / f"{base}.mcap"), n) for base in BASES for n in range(_PARTS)]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        parts = pool.map(_part, *zip(*jobs, strict=True))
        for digests, kind, name, code, fault in chain.from_iterable(parts):
            if code is None:
                continue
            row = rows.setdefault(kind, Row())
            row["edits"] += 1
            row[f"refused, {digests}" if code != VERIFIED else "let pass"] += 1
            if fault:
                wrong.append(f"{name} (digests {digests}): {fault}")
    print("\n".join(wrong))
    heads = ("edits", *(f"refused, {digests}" for digests in DIGESTS), "let pass")
    print(f"{'kind':24}" + "".join(f"{head:>16}" for head in heads))
    for kind, row in sorted(rows.items()):
        print(f"{kind:24}" + "".join(f"{row[head]:16}" for head in heads))
    total: Counter[str] = sum(rows.values(), Counter())
    refused = sum(total[f"refused, {digests}"] for digests in DIGESTS)
    print(
        f"{total['edits']} edits of {len(BASES)} recordings: {refused} refused, "
        f"{total['let pass']} verify and show what their plans give, {len(wrong)} wrong"
    )
    return 1 if wrong else 0


def check_honest(folder: Path, count: int) -> int:
    """Verify random honest runs: 80 % offline, 16 % in lock-step, 4 % in real time."""
    lockstep, real_time = max(count * 16 // 100, 1), max(count * 4 // 100, 1)
    runs: Iterator = chain(
        offline_runs(count - lockstep - real_time, folder),
        graph_runs(lockstep, folder, lockstep=True),
        graph_runs(real_time, folder, lockstep=False),
    )
    counts: Counter[str] = Counter()
    for run in runs:
        counts["runs"] += 1
        counts["complete"] += run.complete
        if run.accused:
            counts["accused"] += 1
            print(f"{run.name}: {run.accused}", flush=True)
    print(
        f"{counts['runs']} honest runs, {counts['complete']} complete: {counts['accused']} accused"
    )
    return 1 if counts["accused"] else 0


def main(arguments: list[str]) -> int:
    """Run one part, or both."""
    what, count = (*arguments, "", "")[:2]
    if what not in ("", "edits", "honest") or not re.fullmatch(r"\d*", count):
        print(__doc__, file=sys.stderr)
        return 2
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    with tempfile.TemporaryDirectory() as name:
        codes = [0]
        if what != "honest":
            codes.append(check_edits(Path(name)))
        if what != "edits":
            codes.append(check_honest(Path(name), int(count or 500)))
    return max(codes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
