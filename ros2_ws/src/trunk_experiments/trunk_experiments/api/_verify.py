"""`Verification`: whether a recording follows from itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

from trunk_msgs_util.text import printable

from ._paths import AnyPath, path_of
from ._run import Run
from ._shown import html_table
from ._simulate import run_of

Word = Literal["verified", "diverges", "inconclusive", "not signed"]


@dataclass(frozen=True)
class CheckedPart:
    """One kind of recomputation: ``steps`` were recomputed, and ``diverging`` of them differ.

    Made by `verify`. ``first``: the first difference, with topic, stamp, both values, and distance in ULPs.
    """

    name: str
    steps: int
    diverging: int
    first: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Verification:
    """What recomputing a recording found.

    Made by `verify`. ``verdict``: ``verified``, ``diverges``, ``inconclusive`` or ``not signed``.
    ``judged``: which part of the run was judged, in words. ``checked``: what was recomputed. ``reasons``: why
    it is not verified, one line each; empty if it is. ``not_judged``: what no check covers. ``notes``: what
    else there is to know, such as a signature.
    """

    verdict: Word
    judged: str
    checked: tuple[CheckedPart, ...]
    reasons: tuple[str, ...]
    not_judged: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def verified(self) -> bool:
        """True if every command and, where time was exact, every state follows, bit by bit."""
        return self.verdict == "verified"

    @property
    def steps(self) -> int:
        """How many steps were recomputed, of all kinds."""
        return sum(check.steps for check in self.checked)

    def __repr__(self) -> str:
        summary = [self.verdict, *([self.judged] if self.judged else []), *self.reasons]
        return printable(f"Verification({'; '.join(summary)})")

    def _repr_html_(self) -> str:
        rows: list[tuple[str, str]] = [("judged", self.judged)] if self.judged else []
        rows += [
            (check.name, f"{check.steps} steps, {check.diverging or 'none'} diverging")
            for check in self.checked
        ]
        rows += [("reason", line) for line in self.reasons]
        rows += [("not judged", line) for line in self.not_judged]
        rows += [("note", line) for line in self.notes]
        return html_table(f"Verification: {self.verdict}", ("", ""), rows)


def verify(run: Run | AnyPath, *, key: AnyPath | None = None) -> Verification:
    """Recompute every command of a recording and, where time was exact, every state.

    ``key``: the file of the public Ed25519 key that must have signed it; None: any
    signature beside the recording counts, whoever made it.

    Raises RecordingError for a recording that cannot be read, and another `TrunkError` for an invalid key.
    """
    from trunk_msgs_util.recording.signing.keys import public_key, read_key

    from ..replay.signed import judge_signature
    from ..replay.verify import describe, verdict_on

    file = None if key is None else path_of(key, "key")
    trusted = None if file is None else public_key(read_key(file), str(file))
    recorded = run_of(run)._recorded
    verdict = verdict_on(recorded)
    judge_signature(verdict, recorded.recording, trusted, str(file))
    return Verification(
        cast("Word", verdict.word),
        verdict.judged,
        tuple(
            CheckedPart(
                part.name,
                part.steps,
                part.wrong_steps,
                tuple(describe(step) for step in part.first),
            )
            for part in verdict.checks
        ),
        tuple(verdict.reasons),
        tuple(verdict.unjudged),
        tuple(verdict.notes),
    )
