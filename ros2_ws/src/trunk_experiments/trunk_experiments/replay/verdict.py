"""What `verify` found: checks and their results, what does not fit, what was not judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, NamedTuple

from trunk_msgs_util.text import bounded, printable
from trunk_msgs_util.units import seconds

from ..results import OMITTED, Count, html_table
from .checks import Check, CheckWord, describe
from .doubts import RecordingResult, Word, about

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun

__all__ = [
    "DIVERGES",
    "UNJUDGED",
    "VERIFIED",
    "Check",
    "Verdict",
    "Verification",
    "verification",
]

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
