"""Schedules of the virtual world, repeated with real processes over DDS: the same invariants hold."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import pytest

from ..seeds.invariants import broken
from ..seeds.story import Story, draw
from .peer import Peer
from .processes import Children
from .scenario import Scenario, can_be_forced

pytestmark = pytest.mark.graph

_FEW, _ALL = 1, 60


def sample() -> list[Story]:
    """Return the first stories in which something happens and that can be forced."""
    stories = (draw(seed) for seed in range(1000))
    return list(islice((one for one in stories if one.faults and can_be_forced(one)), _ALL))


@pytest.mark.parametrize(
    "story",
    [
        pytest.param(story, marks=[pytest.mark.long] * (i >= _FEW), id=f"seed {story.seed}")
        for i, story in enumerate(sample())
    ],
)
def test_the_invariants_hold_with_real_processes(
    story: Story, children: Children, peer: Peer, tmp_path: Path
) -> None:
    scenario = Scenario(story, children, peer, tmp_path)
    scenario.play()
    found = list(broken(scenario))
    said = "\n".join(
        f"{name}: {one.log}" for name, some in scenario.processes.items() for one in some
    )
    faults = "\n".join(fault.describe() for fault in scenario.story.faults)
    assert not found, f"{scenario.story}\n{faults}\n{said}"
