"""What `verify` compares, bit by bit, and what it found: checks and their results, what was not judged."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, NamedTuple

import numpy as np

from trunk_core.arrays import Bools, Floats, Integers
from trunk_core.results import OMITTED, Count, html_table
from trunk_core.text import bounded, printable
from trunk_core.units import seconds

from .doubts import RecordingResult, Word, about
from .recorded_run import RecordedRun

# What a difference may be besides a value.
ACTIVE_CONTROLLERS = "active controllers"
MISSING = "missing"
UNEXPECTED = "unexpected"
DIVERGED = "diverged"
CheckWord = Literal["verified", "diverges", "inconclusive", "taken as recorded"]


class Difference(NamedTuple):
    """One value in which record and computation differ."""

    stamp_ns: int
    topic: str
    field: str
    recorded: float
    computed: float


class ComparedColumn(NamedTuple):
    """Values of one field of a topic, as recorded and as computed [n]."""

    topic: str
    field: str
    recorded: Floats
    computed: Floats


@dataclass
class Check:
    """One local check: over which span, of how many steps, how many differ, and why some were not judged."""

    name: str
    steps: int = 0
    wrong_steps: int = 0
    first: list[Difference] = field(default_factory=list)
    from_ns: int | None = None
    until_ns: int | None = None
    reason: str = ""  # why it is inconclusive; empty: it is not
    unjudged: int = 0  # steps
    taken: bool = False  # as it was recorded: there is nothing to compare with
    _equal_before: tuple[int, int] = (
        0,
        -1,
    )  # steps before the first difference, the last one's stamp

    @property
    def result(self) -> CheckWord:
        """The check's own verdict in a word."""
        if self.wrong_steps:
            return "diverges"
        if self.taken:
            return "taken as recorded"
        return "inconclusive" if self.reason or not self.steps else "verified"

    def take(self, stamps: Integers, judged: Bools, columns: Sequence[ComparedColumn]) -> None:
        """Compare some steps [n], those that can be ``judged``."""
        self.unjudged += int(np.count_nonzero(~judged))
        rows = np.flatnonzero(judged)
        if not len(rows):
            return
        self.add(stamps, rows, np.flatnonzero(unequal(columns, len(stamps)) & judged), columns)

    def add(
        self, stamps: Integers, rows: Integers, wrong: Integers, columns: Sequence[ComparedColumn]
    ) -> None:
        """Count the steps in these rows, of which those in the rows ``wrong`` differ."""
        if len(wrong) and not self.first:
            row = int(wrong[0])
            self._equal_before = (
                self.steps + int(np.count_nonzero(rows < row)),
                int(stamps[row - 1]) if row else (self.until_ns or -1),
            )
            self.first = differences_in(row, stamps, columns)
        self.steps += len(rows)
        self.wrong_steps += len(wrong)
        if len(rows):
            self.from_ns = int(stamps[rows[0]]) if self.from_ns is None else self.from_ns
            self.until_ns = int(stamps[rows[-1]])

    def note(self, difference: Difference) -> None:
        """Count a step that differs otherwise than in a value."""
        if not self.first:
            self._equal_before = self.steps, self.until_ns or -1
            self.first = [difference]
        self.steps += 1
        self.wrong_steps += 1

    def excuse(self, why: str) -> None:
        """Judge only what comes before the first difference: what follows may lack something on record."""
        if self.wrong_steps:
            difference = describe(self.first[0])
            self.unjudged += self.steps - self._equal_before[0]
            self.steps, self.until_ns = self._equal_before
            self.wrong_steps, self.first = 0, []
            self.reason = f"{why}: judged up to {difference}"


def unequal(columns: Sequence[ComparedColumn], count: int) -> Bools:
    """Return which of ``count`` rows do not have the same 64 bits in each column [count]."""
    different = np.zeros(count, bool)
    for column in columns:
        a, b = (np.ascontiguousarray(v, np.float64).view(np.int64) for v in column[2:])
        different |= a != b
    return different


def differences_in(
    row: int, stamps: Integers, columns: Sequence[ComparedColumn]
) -> list[Difference]:
    """Return the differences in a row, in the order of the columns."""
    values = [(*column[:2], float(column[2][row]), float(column[3][row])) for column in columns]
    return [Difference(int(stamps[row]), *v) for v in values if not same(*v[2:])]


def same(a: float, b: float) -> bool:
    """Return True where both have the same 64 bits (so NaN equals itself, and 0.0 differs from -0.0)."""
    return struct.pack("<d", a) == struct.pack("<d", b)


def apart(a: float, b: float) -> str:
    """Return how far apart two values are, as the end of a line; empty where one is NaN."""
    distance = ulps(a, b)
    return "" if distance is None else f", {distance} ULP apart"


def ulps(a: float, b: float) -> int | None:
    """Return the distance from ``a`` to ``b`` in doubles; None where one is NaN.

    0.0 and -0.0 are 0 apart, though their bits differ.
    """
    if a != a or b != b:
        return None
    return abs(_ordered(a) - _ordered(b))


def _ordered(value: float) -> int:
    """Return the double's bits as an integer that increases with the value."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return int(bits) if bits >= 0 else -(bits & 0x7FFF_FFFF_FFFF_FFFF)


def describe(difference: Difference) -> str:
    """Return a difference as one line: where, both values, how far apart."""
    at = f"t = {seconds(difference.stamp_ns):g} s: {difference.topic}"
    if difference.field == MISSING:
        return f"{at}: no message with this stamp"
    if difference.field == UNEXPECTED:
        return f"{at}: a message with this stamp, where none was to be sent"
    if difference.field == ACTIVE_CONTROLLERS:
        count = f"{difference.recorded:.0f} controllers are active by the run's events"
        return f"t = {seconds(difference.stamp_ns):g} s: {count}, 1 gave a command"
    recorded, computed = difference.recorded, difference.computed
    if difference.field == DIVERGED:
        return f"{at}: recorded with an angle of {recorded!r}, computed the plant diverges in this step"
    values = f"recorded {recorded!r}, computed {computed!r}{apart(recorded, computed)}"
    return f"{at}: {difference.field}: {values}"


VERIFIED, DIVERGES, UNJUDGED = 0, 1, 2


@dataclass
class Verdict:
    """What `verify` found.

    ``altered``: what is not as the recorder wrote it, by its digests, even if no computed bit depends on it.
    ``obstacles``: why the run cannot be judged as a whole. ``unjudged``: what no check looks at.
    """

    checks: list[Check] = field(default_factory=list)
    altered: list[str] = field(default_factory=list)
    obstacles: list[str] = field(default_factory=list)
    unjudged: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    judged: str = ""  # the run in a few words

    @property
    def exit_code(self) -> int:
        """0: verified, 1: it diverges, 2: inconclusive."""
        if self.diverges:
            return DIVERGES
        return UNJUDGED if self.obstacles or not self._judged else VERIFIED

    @property
    def _judged(self) -> bool:
        return bool(self.checks) and all(check.steps for check in self.checks)

    @property
    def diverges(self) -> bool:
        """True if something differs from what was computed, or was recorded."""
        return bool(self.altered) or any(c.wrong_steps for c in self.checks)

    @property
    def word(self) -> Word:
        """The verdict in a word."""
        words: tuple[Word, ...] = ("verified", "diverges", "inconclusive")
        return words[self.exit_code]

    @property
    def reasons(self) -> list[str]:
        """Why it is not verified, a line each; empty if it is."""
        return [
            *(f"altered: {part}" for part in self.altered),
            *self.obstacles,
            *(f"{check.name}: {describe(check.first[0])}" for check in self.checks if check.first),
        ]


class CheckedPart(NamedTuple):
    """One kind of recomputation."""

    name: str
    result: CheckWord
    steps_checked: Count
    steps_diverging: Count
    steps_not_judged: Count
    reason: Annotated[str | None, "Why it is inconclusive"]
    from_s: float | None
    until_s: float | None
    first_divergence: Annotated[Sequence[str], "Topic, stamp, both values, distance in ULPs"]


@dataclass(frozen=True, repr=False)
class Verification(RecordingResult, document="verify-2"):
    """What recomputing a recording found: the document of ``trunk verify``.

    Made by `verify`. ``reasons``: why it is not verified, one line each; empty if it is.
    """

    verdict: Word
    extent: Annotated[str | None, "What was judged, in a few words"]
    parts: Annotated[tuple[CheckedPart, ...], "What was recomputed"]
    altered: Annotated[Sequence[str], "What is not as the recorder wrote it, by its digests"]
    obstacles: Annotated[Sequence[str], "Why the run cannot be judged as a whole"]
    not_judged: Annotated[Sequence[str], "What no check looks at"]
    notes: Annotated[Sequence[str], "What else there is to know"]
    reasons: Annotated[Sequence[str], OMITTED]

    @property
    def verified(self) -> bool:
        """True if every command and, where time was exact, every state follows, bit by bit."""
        return self.verdict == "verified"

    @property
    def steps(self) -> int:
        """How many steps were recomputed, of all kinds."""
        return sum(part.steps_checked for part in self.parts)

    def __repr__(self) -> str:
        summary = [self.verdict, *([self.extent] if self.extent else []), *self.reasons]
        return printable(f"Verification({'; '.join(summary)})")

    def _repr_html_(self) -> str:
        rows = [("judged", self.extent)] if self.extent else []
        rows += [
            (p.name, f"{p.steps_checked} steps, {p.steps_diverging or 'none'} diverging")
            for p in self.parts
        ]
        rows += [("reason", line) for line in self.reasons]
        rows += [("not judged", line) for line in self.not_judged]
        rows += [("note", line) for line in self.notes]
        return html_table(f"Verification: {self.verdict}", ("", ""), rows)


def verification(run: RecordedRun, verdict: Verdict) -> Verification:
    """Return a verdict on a run as it is shown."""
    parts = (
        CheckedPart(
            check.name,
            check.result,
            check.steps,
            check.wrong_steps,
            check.unjudged,
            check.reason or None,
            None if check.from_ns is None else seconds(check.from_ns),
            None if check.until_ns is None else seconds(check.until_ns),
            [describe(difference) for difference in check.first],
        )
        for check in verdict.checks
    )
    return Verification(
        **vars(about(run, judged=verdict.word)),
        verdict=verdict.word,
        extent=verdict.judged or None,
        parts=tuple(parts),
        altered=[*map(bounded, verdict.altered)],
        obstacles=[*map(bounded, verdict.obstacles)],
        not_judged=[*map(bounded, verdict.unjudged)],
        notes=[*map(bounded, verdict.notes)],
        reasons=[*map(bounded, verdict.reasons)],
    )
