"""Schedules of the virtual world, repeated with real processes over DDS: the same invariants hold.

Virtual runs last tenths of a second; here they last seconds, and the faults come as much later. In
lock-step the plant is held to the clock's pace, so that a fault hits its step, give or take a few.
"""

import random
import time
from collections.abc import Set
from functools import partial
from itertools import islice
from pathlib import Path

import pytest

from trunk_msgs_util.node.conversions import stamp_from_ros

from ..seeds.invariants import broken, harmless
from ..seeds.story import CONTROLLERS, NS, Fault, Request, Story, draw, requests
from .peer import Peer
from .play import Play
from .processes import Children

pytestmark = pytest.mark.graph

_FEW, _ALL = 1, 60
_SLOWER = 20
_QUIET_S = 8.0  # after which a story that was kept from its end is over
# Wall clock and disk cannot be forced from outside.
_FORCED = {
    *("stall", "crash", "restart", "stop", "late", "second", "reset", "pause", "gains"),
    *("deactivate", "activate", "cleanup"),
}


class Scenario(Play):
    """A seed's story: the same faults, as far as they can be forced from outside."""

    complaints = ""  # all that is said goes to the logs

    def __init__(self, story: Story, children: Children, peer: Peer, folder: Path) -> None:
        super().__init__(children, peer, folder, f"{story.seed}.mcap")
        faults = (
            fault._replace(at_ns=_SLOWER * fault.at_ns) if fault.running else fault
            for fault in story.faults
        )
        self.story = story._replace(duration=_SLOWER * story.duration, faults=tuple(faults))
        self._chance = random.Random(story.seed)
        self._to_come = [fault for fault in self.story.faults if fault.running]  # by stamps
        self._heard = time.monotonic()
        self._states = peer.hear_live("/joint_states")
        for fault in self.story.faults:
            for request in requests(fault):
                self.prepare(request)

    def play(self) -> None:
        """Play it, then stop all that is left: the recorder last, as ``trunk run`` does."""
        wait_s = {f.node: f.value for f in self.story.faults if f.kind == "late"}
        # A process stalled from outside stays so until this one gets its turn.
        paced = {"lockstep.speed": 1.0, "lockstep.timeout": 60.0} if self.story.lockstep else {}
        plan = self.story.plan(**paced)
        plan.write_parameters(self.folder / "params.yaml")
        for name in plan.configs:
            self.after(wait_s.get(name, 0.0), partial(self.start, name))
        for fault in self.story.faults:
            if not fault.running:
                self.after(fault.at_ns / NS, partial(self._strike, fault))
        self.wait(self._over, f"the story of seed {self.story.seed} is over")
        others = sorted(set(self.processes) - {"simulator", "recorder"})
        self.end((["simulator"], others, ["recorder"]))

    def published(self, topic: str, counted: Set[str] | None = None) -> None:
        """Return None: nobody counts what is published."""

    def _over(self) -> bool:
        self.act()
        now = time.monotonic()
        if self._states:
            self._heard = now
            stamp_ns = stamp_from_ros(self._states[-1].header.stamp)
            self._states.clear()
            for fault in [fault for fault in self._to_come if fault.at_ns <= stamp_ns]:
                self._to_come.remove(fault)
                self._strike(fault)
        ended = bool(self.processes["simulator"]) and not self.alive("simulator")
        # A story that nothing keeps from its end reaches it, however busy the machine.
        given_up = not harmless(self.story) and not self._due and now - self._heard > _QUIET_S
        return ended or given_up

    def _strike(self, fault: Fault) -> None:
        if fault.kind == "second":
            name = next(name for name in CONTROLLERS if name != self.story.controller)
            plan = self.story._replace(controller=name, duration=60.0).plan()
            plan.write_parameters(self.folder / "second.yaml")
            self.start(name, "second.yaml")
        elif asked := requests(fault):
            if self.alive(fault.node):
                self._ask(*asked)
        elif fault.kind != "late":
            wait_s = self._chance.uniform(0.1, 2.0) if fault.kind == "restart" else fault.value
            self.strike(fault.kind, fault.node, wait_s, partial(self.start, fault.node))

    def _ask(self, *asked: Request) -> None:
        self.ask(asked[0])
        if asked[1:]:
            self.after(self._chance.uniform(0.01, 1.0), partial(self._ask, *asked[1:]))


def sample() -> list[Story]:
    """Return the first stories in which something happens and that can be forced."""
    stories = (draw(seed) for seed in range(1000))
    forced = (s for s in stories if s.faults and {fault.kind for fault in s.faults} <= _FORCED)
    return list(islice(forced, _ALL))


@pytest.mark.parametrize(
    "story",
    [
        pytest.param(story, marks=[pytest.mark.one_in(30)] * (i >= _FEW), id=f"seed {story.seed}")
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
