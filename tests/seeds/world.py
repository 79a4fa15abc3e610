"""A virtual world for real nodes: one clock, one network and a scheduler, all driven by a seed.

Each process of nodes is a greenlet that runs the real `run_nodes` with the real executor. Where it would wait
for the middleware, sleep, or wait for acknowledgements, it returns to the scheduler, which takes the next
event: a message arrives, somebody is discovered, a process wakes, a fault strikes. Time goes on from event to
event alone.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from greenlet import GreenletExit, getcurrent, greenlet

from .network import Network
from .story import NS

_LOOK_NS = 1_000  # what it takes to look at the clock
_MOST_EVENTS = 400_000
HELD_NS = 10**18  # until it is let go


class HungError(Exception):
    """The world did not come to rest."""


@dataclass(eq=False)
class Process:
    """A process of nodes: what runs in it, and whether it waits."""

    name: str
    world: World
    main: Callable[[], int]
    number: int
    parameters: Mapping[str, Mapping[str, Any]]
    renamed: Mapping[str, str] = field(default_factory=dict)  # its node: __node, __ns
    context: Any = None
    handlers: dict[int, Any] = field(default_factory=dict)
    pending: list[int] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    stderr: Any = None  # its own
    exit_code: int | None = None
    ended_ns: int | None = None
    crashed: bool = False
    stalled_ns: int = 0
    ready: Callable[[], bool] | None = None  # what it waits for besides the time
    wake: int = 0  # the wait that counts
    run: greenlet | None = None

    @property
    def alive(self) -> bool:
        return self.exit_code is None and not self.crashed

    @property
    def held(self) -> bool:
        return self.stalled_ns == HELD_NS

    @property
    def identity(self) -> str:
        """The identity that its nodes report."""
        return identity_of(self.number)


def identity_of(number: int) -> str:
    """Return the identity of a process by its number."""
    return f"virtual.{number}.0"


class World:
    """The scheduler: ``delay`` draws how long something takes, ``note`` writes the trace."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.now_ns = 0
        self.trace: list[str] = []
        self.processes: list[Process] = []
        self.first = 1000  # the first process's number
        self.network = Network(self)
        self.names: dict[str, Process] = {}  # of nodes, by the process that holds each
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()
        self._hub = getcurrent()
        self.current: Process | None = None
        self.switched: Callable[[Process | None], None] = lambda process: None

    # Time and events.

    def at(self, delay_ns: int, action: Callable[[], None]) -> None:
        """Do something after a time."""
        heapq.heappush(self._events, (self.now_ns + max(delay_ns, 0), next(self._order), action))

    def delay(self, usual_ns: int, longest_ns: int) -> int:
        """Draw a time: mostly about the usual one, now and then up to the longest."""
        if self.random.random() < 0.9:
            return self.random.randrange(1, 2 * usual_ns)
        return self.random.randrange(usual_ns, longest_ns)

    def note(self, *words: object) -> None:
        """Write a line of the trace."""
        self.trace.append(f"{self.now_ns / NS:.6f} {' '.join(map(str, words))}")

    def look(self) -> int:
        """Return the time in ns; looking takes some, so that nobody looks for ever."""
        self.now_ns += _LOOK_NS
        return self.now_ns

    # Processes.

    def start(
        self, name: str, main: Callable[[], int], parameters: Mapping[str, Mapping[str, Any]]
    ) -> Process:
        """Begin a process; it runs at the next event."""
        process = Process(name, self, main, self.first + len(self.processes), parameters)
        self.processes.append(process)
        process.run = greenlet(lambda: self._main(process), self._hub)
        self.note("start", name)
        self.at(self.delay(2_000_000, 200_000_000), lambda: self._resume(process, process.wake))
        return process

    def _main(self, process: Process) -> None:
        try:
            process.exit_code = process.main()
        except GreenletExit:
            return
        except SystemExit as error:
            process.exit_code = int(error.code or 0)
        process.ended_ns = self.now_ns
        self.note("exit", process.name, process.exit_code)
        self.network.gone(process, self.delay(1_000_000, 50_000_000))

    def _resume(self, process: Process, wake: int, error: Exception | None = None) -> None:
        if not process.alive or wake != process.wake or process.run is None:
            return
        if process.stalled_ns > self.now_ns:
            self.at(process.stalled_ns - self.now_ns, lambda: self._resume(process, wake))
            return
        process.wake += 1
        process.ready = None
        self.current = process
        self.switched(process)
        try:
            if error is None:
                process.run.switch()
            else:
                process.run.throw(error)
        finally:
            self.current = None
            self.switched(None)

    def block(self, limit_ns: int, ready: Callable[[], bool] | None = None) -> None:
        """Let the current process wait until something is ready, or for a time (below 0: for ever)."""
        process = self.current
        assert process is not None
        if ready is not None and ready():
            return
        if limit_ns == 0:
            return
        process.ready = ready
        wake = process.wake
        if limit_ns > 0:
            self.at(limit_ns, lambda: self._resume(process, wake))
        self._hub.switch()

    def nudge(self, process: Process) -> None:
        """Let a process run soon if what it waits for is ready now."""
        if process.alive and process.ready is not None and process.ready():
            wake = process.wake
            self.at(self.delay(20_000, 2_000_000), lambda: self._resume(process, wake))

    def signal(self, process: Process, number: int) -> None:
        """Send a process a signal that it handles."""
        if process.alive:
            self.note("signal", process.name, number)
            handler = process.handlers.get(number)
            if handler is None:
                process.pending.append(
                    number
                )  # blocked until it can be handled, as the launchers do
            elif callable(handler):
                handler(number, None)

    def crash(self, process: Process) -> None:
        """Kill a process: it does nothing more, and others learn of it late."""
        if process.alive:
            process.crashed = True
            self.note("crash", process.name)
            self.network.gone(process, self.delay(2 * NS, 20 * NS))

    def hold(self, process: Process) -> None:
        """Let a process do nothing until it is let go, its middleware neither."""
        process.stalled_ns = HELD_NS

    def let_go(self, process: Process) -> None:
        """Let a process that was held go on."""
        process.stalled_ns = 0
        self.network.joined(process)
        self.network.go_on(process)
        wake = process.wake
        self.at(0, lambda: self._resume(process, wake))

    def give_up(self, process: Process, error: Exception) -> None:
        """Let a process's wait raise an error."""
        self._resume(process, process.wake, error)

    def run(self, until: Callable[[], bool], limit_ns: int, most: int = _MOST_EVENTS) -> None:
        """Take events until something holds. Raises HungError after a time, or too many events."""
        for _ in range(most):
            if until():
                return
            if not self._events:
                raise HungError("nothing is left to happen")
            if self._events[0][0] > limit_ns:
                raise HungError(f"not over at t = {limit_ns / NS:g} s of virtual time")
            when, _, action = heapq.heappop(self._events)
            self.now_ns = max(self.now_ns, when)
            action()
        raise HungError(f"not over after {most} events")

    def bury(self) -> None:
        """End what still runs, silently."""
        for process in self.processes:
            if process.run is not None and not process.run.dead:
                process.crashed = True
                process.run.throw(GreenletExit)
