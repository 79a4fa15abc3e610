"""A seed's story with real processes: the same faults, as far as they can be forced from outside.

Virtual runs last tenths of a second; here they last seconds, and the faults come as much later. In
lock-step the plant is held to the clock's pace, so that a fault hits its step, give or take a few.
"""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Callable, Set
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from trunk_msgs_util.node.conversions import stamp_from_ros

from ..seeds.invariants import harmless
from ..seeds.story import CONTROLLERS, NS, Fault, Request, Story, requests
from .peer import Peer
from .processes import Child, Children

_SLOWER = 20
_QUIET_S = 8.0  # after which a story that was kept from its end is over
_FORCED = {
    *("stall", "crash", "restart", "stop", "late", "second", "reset", "pause", "gains"),
    *("deactivate", "activate", "cleanup"),
}


def can_be_forced(story: Story) -> bool:
    """Return True if all of its faults can be caused from outside; wall clock and disk cannot."""
    return all(fault.kind in _FORCED for fault in story.faults)


@dataclass
class Process:
    """A node's process, as the invariants know it."""

    child: Child

    @property
    def alive(self) -> bool:
        return self.child.process.poll() is None

    @property
    def exit_code(self) -> int | None:
        code = self.child.process.poll()
        return None if code is None or code < 0 else code

    @property
    def log(self) -> list[str]:
        return self.child.stderr.splitlines()


class Scenario:
    """The processes of a story, and what is still to happen to them."""

    complaints = ""  # all that is said goes to the logs

    def __init__(self, story: Story, children: Children, peer: Peer, folder: Path) -> None:
        faults = (
            fault._replace(at_ns=_SLOWER * fault.at_ns) if fault.running else fault
            for fault in story.faults
        )
        self.story = story._replace(duration=_SLOWER * story.duration, faults=tuple(faults))
        self.folder, self.path = folder, folder / f"{story.seed}.mcap"
        self.processes: dict[str, list[Process]] = {}
        self._chance = random.Random(story.seed)
        self._children, self._peer = children, peer
        self._due: list[tuple[float, Callable[[], None]]] = []  # by the clock
        self._to_come = [fault for fault in self.story.faults if fault.running]  # by stamps
        self._begun = self._heard = time.monotonic()
        self._states = peer.hear_live("/joint_states")
        self._clients = {
            service: peer.node.create_client(kind, service)
            for fault in self.story.faults
            for service, kind, _ in requests(fault)
        }

    def play(self) -> None:
        """Play it, then stop all that is left: the recorder last, as ``trunk run`` does."""
        wait_s = {f.node: f.value for f in self.story.faults if f.kind == "late"}
        # A process stalled from outside stays so until this one gets its turn.
        paced = {"lockstep.speed": 1.0, "lockstep.timeout": 60.0} if self.story.lockstep else {}
        plan = self.story.plan(**paced)
        plan.write_parameters(self.folder / "params.yaml")
        for name in plan.configs:
            self.processes[name] = []
            self._after(wait_s.get(name, 0.0), partial(self._start, name))
        for fault in self.story.faults:
            if not fault.running:
                self._after(fault.at_ns / NS, partial(self._strike, fault))
        self._peer.until(self._over, f"the story of seed {self.story.seed} is over")
        self._due = []
        self._stop()

    def published(self, topic: str, counted: Set[str] | None = None) -> None:
        """Return None: nobody counts what is published."""

    # What happens when.

    def _after(self, wait_s: float, action: Callable[[], None]) -> None:
        self._due.append((time.monotonic() + wait_s, action))

    def _over(self) -> bool:
        now = time.monotonic()
        for one in [one for one in self._due if one[0] <= now]:
            self._due.remove(one)
            one[1]()
        if self._states:
            self._heard = now
            stamp_ns = stamp_from_ros(self._states[-1].header.stamp)
            self._states.clear()
            for fault in [fault for fault in self._to_come if fault.at_ns <= stamp_ns]:
                self._to_come.remove(fault)
                self._strike(fault)
        simulators = self.processes["simulator"]
        ended = bool(simulators) and not simulators[-1].alive
        # A story that nothing keeps from its end reaches it, however busy the machine.
        given_up = not harmless(self.story) and not self._due and now - self._heard > _QUIET_S
        return ended or given_up

    def _start(self, name: str) -> None:
        given = ["--params-file", self.folder / "params.yaml"]
        given += [f"output:={self.path}"] if name == "recorder" else []
        some = self.processes.setdefault(name, [])
        some.append(Process(self._children.node(name, *given, name=f"{name}_{len(some)}")))

    def _strike(self, fault: Fault) -> None:
        kind, some = fault.kind, self.processes.get(fault.node)
        if kind == "second":
            self._start_second()
        if kind in {"second", "late"} or not some:
            return
        process = some[-1]
        if not process.alive:
            return
        if kind == "stall":
            process.child.send(signal.SIGSTOP)
            self._after(fault.value, partial(process.child.send, signal.SIGCONT))
        elif kind in {"crash", "restart"}:
            process.child.send(signal.SIGKILL)
            if kind == "restart":
                self._after(self._chance.uniform(0.1, 2.0), partial(self._start, fault.node))
        elif kind == "stop":
            process.child.send(signal.SIGINT)
        else:
            self._ask(*requests(fault))

    def _start_second(self) -> None:
        name = next(name for name in CONTROLLERS if name != self.story.controller)
        file = self.folder / "second.yaml"
        self.story._replace(controller=name, duration=60.0).plan().write_parameters(file)
        child = self._children.node(name, "--params-file", file, name="second")
        self.processes["second"] = [Process(child)]

    def _ask(self, *asked: Request) -> None:
        """Call services one after another; wait for no answer, for the node may be stalled or dying."""
        (service, kind, fields), *then = asked
        self._clients[service].call_async(kind.Request(**fields))
        if then:
            self._after(self._chance.uniform(0.01, 1.0), partial(self._ask, *then))

    def _stop(self) -> None:
        names = sorted(set(self.processes) - {"simulator", "recorder"})
        for some in (["simulator"], names, ["recorder"]):
            left = [one for name in some for one in self.processes[name]]
            for process in left:
                process.child.send(signal.SIGCONT)  # to what is still stopped
                process.child.send(signal.SIGINT)
            for process in left:
                process.child.wait()
