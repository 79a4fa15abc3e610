"""Real nodes in the virtual world of tests/seeds: runs in lock-step without faults, and what became of seeds.

To be imported before rclpy, with PYTHONHASHSEED=0: the order of sets of names is part of a seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar
from unittest.mock import patch

from trunk_experiments.plans.plan import RunPlan
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.recording.reader import Recording

from ..seeds import check
from ..seeds.promises import Run
from ..seeds.story import Story, draw
from .contents import digest_of
from .runs import LOCKSTEP, Fingerprint, fingerprint, word_of

Judged = TypeVar("Judged")

# The letter for each word: a capital if the recording is complete.
LETTERS = {
    "verified": "v",
    "diverges": "d",
    "cannot be judged": "c",
    "no verdict": "e",
    "unreadable": "u",
    "no file": "n",
}


class _Planned(Story):
    """A story without faults, with a plan of its own."""

    own: RunPlan

    def plan(self, **_: object) -> RunPlan:
        return self.own


def in_lockstep(name: str, folder: Path) -> Fingerprint:
    """Run a plan's nodes in lock-step and return what came of it."""
    plan = LOCKSTEP[name]()
    story = _Planned(0, True, plan.controller_name, plan.simulator.duration, ())
    story.own = plan
    return _played(story, folder, lambda run: fingerprint(run.path, graph=True))


def outcome(seed: int, folder: Path) -> tuple[str, str, str]:
    """Return what became of a seed: its mode, the letter of its verdict, its recording's digest."""
    story = draw(seed)
    letter, digest = _played(story, folder, lambda run: _letter(run.path))
    return "lockstep" if story.lockstep else "real_time", letter, digest


def _played(story: Story, folder: Path, judge: Callable[[Run], Judged]) -> Judged:
    """Let a story happen; instead of its promises, judge its recording as it is left for them."""
    judged: list[Judged] = []

    def instead(run: Run) -> Iterator[str]:
        judged.append(judge(run))
        return iter(())

    with patch.object(check, "broken", instead):
        check.play(story, folder)
    return judged[0]


def _letter(path: Path) -> tuple[str, str]:
    if not path.exists():
        return LETTERS["no file"], ""
    try:
        complete = Recording.open(path).complete
    except TrunkError:
        return LETTERS["unreadable"], digest_of(path)
    try:
        word = word_of(path)
    except TrunkError:
        word = "no verdict"
    letter = LETTERS[word]
    return letter.upper() if complete else letter, digest_of(path)
