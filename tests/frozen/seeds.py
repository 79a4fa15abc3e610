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
from ..seeds.invariants import Run
from ..seeds.story import Story, draw
from .contents import digest_of
from .runs import LOCKSTEP, Fingerprint, fingerprint, word_of
from .verdicts import LETTERS, NO_FILE, Outcome

Judged = TypeVar("Judged")

COUNT = 2100  # seeds that are frozen, from 0 on


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


def outcomes(folder: Path) -> Iterator[Outcome]:
    """Yield what becomes of each seed."""
    for seed in range(COUNT):
        story = draw(seed)
        mode = "lockstep" if story.lockstep else "real_time"
        yield Outcome(mode, *_played(story, folder, _judged))


def _played(story: Story, folder: Path, judge: Callable[[Run], Judged]) -> Judged:
    """Let a story happen; instead of its promises, judge its recording as it is left for them."""
    judged: list[Judged] = []

    def instead(run: Run) -> Iterator[str]:
        judged.append(judge(run))
        return iter(())

    with patch.object(check, "broken", instead):
        check.play(story, folder)
    return judged[0]


def _judged(run: Run) -> tuple[str, str]:
    """Return the letter of the verdict on a recording, and the recording's digest."""
    if not run.path.exists():
        return LETTERS["no file"], NO_FILE
    digest = digest_of(run.path)
    try:
        complete = Recording.open(run.path).complete
    except TrunkError:
        return LETTERS["unreadable"], digest
    try:
        word = word_of(run.path)
    except TrunkError:
        word = "no verdict"
    letter = LETTERS[word]
    return letter.upper() if complete else letter, digest
