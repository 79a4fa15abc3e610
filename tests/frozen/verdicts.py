"""What became of seeds, a letter each, as it is kept and compared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

MODES = ("lockstep", "real_time")
NO_FILE = "----"  # instead of a digest
_OTHER_MODE = "."
# By word; a capital if the recording is complete.
LETTERS = {
    "verified": "v",
    "diverges": "d",
    "inconclusive": "c",
    "no verdict": "e",
    "unreadable": "u",
    "no file": "n",
}
_IN_A_LINE = 100  # seeds


class Outcome(NamedTuple):
    """What became of a seed."""

    mode: str
    letter: str
    recording: str  # its digest

    @property
    def word(self) -> str:
        """The verdict's word."""
        return next(word for word, letter in LETTERS.items() if letter == self.letter.lower())

    def describe(self) -> str:
        """Return mode, verdict and completeness."""
        return f"{self.mode}, {self.word}{', complete' if self.letter.isupper() else ''}"


class Change(NamedTuple):
    """Seeds whose verdicts changed alike."""

    before: str
    now: str
    seeds: Sequence[int]
    recorded_alike: int  # how many have the recording that they had
    wrong: bool

    def describe(self) -> str:
        """Return it as a line."""
        seeds = " ".join(map(str, self.seeds))
        count = f"{len(self.seeds)} seeds, {self.recorded_alike} with the same recording"
        return f"{self.before}; now {self.now}: {count}: {seeds}"


def packed(outcomes: Iterable[Outcome]) -> dict[str, object]:
    """Return outcomes as strings: a letter in that of the mode, and a digest for each seed."""
    outcomes = list(outcomes)
    texts = {
        mode: "".join(
            outcome.letter if outcome.mode == mode else _OTHER_MODE for outcome in outcomes
        )
        for mode in MODES
    }
    recordings = "".join(outcome.recording for outcome in outcomes)
    return {
        "letters": LETTERS,
        **{mode: _lines(text, _IN_A_LINE) for mode, text in texts.items()},
        "recordings": _lines(recordings, _IN_A_LINE * len(NO_FILE)),
    }


def _lines(text: str, length: int) -> list[str]:
    return [text[at : at + length] for at in range(0, len(text), length)]


def unpacked(values: Mapping[str, Sequence[str]]) -> list[Outcome]:
    """Return the outcomes that were packed so."""
    letters = {mode: "".join(values[mode]) for mode in MODES}
    outcomes = []
    for seed, recording in enumerate(_lines("".join(values["recordings"]), len(NO_FILE))):
        mode = next(mode for mode in MODES if letters[mode][seed] != _OTHER_MODE)
        outcomes.append(Outcome(mode, letters[mode][seed], recording))
    return outcomes


def changes(before: Iterable[Outcome], now: Iterable[Outcome]) -> list[Change]:
    """Return which seeds' verdicts changed, pair by pair.

    It is wrong if a seed diverges that did not, or if the verdict on one in lock-step is another.
    """
    pairs: dict[tuple[str, str], list[tuple[int, Outcome, Outcome]]] = {}
    for seed, (old, new) in enumerate(zip(before, now, strict=True)):
        if old[:2] != new[:2]:
            pairs.setdefault((old.describe(), new.describe()), []).append((seed, old, new))
    return [
        Change(
            *names,
            [seed for seed, _, _ in changed],
            sum(old.recording == new.recording for _, old, new in changed),
            any(_wrong(old, new) for _, old, new in changed),
        )
        for names, changed in sorted(pairs.items())
    ]


def _wrong(old: Outcome, new: Outcome) -> bool:
    other = (old.mode, old.word) != (new.mode, new.word)
    return other and (new.word == "diverges" or "lockstep" in (old.mode, new.mode))
