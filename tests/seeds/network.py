"""The virtual network: who knows whom, and which message reaches whom when, by DDS's rules.

- Discovery runs in each direction separately, and takes time: a publisher sends to the subscriptions that
  it knows; a subscription takes nothing before it knows the publisher; a name may come after its endpoint.
- Reliable: in order per publisher, never lost within the history's depth. Best effort: may be lost.
- Transient local: a late match gets what is kept, up to the depth; volatile: nothing from before.
- A subscription's queue keeps as many messages as its depth; the oldest is dropped for a newer one.
- A publisher that offers less than a subscription requests is not matched with it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .world import Process, World

RELIABLE, BEST_EFFORT = 1, 2
TRANSIENT_LOCAL, VOLATILE = 1, 2
LATENCY_NS = (150_000, 30_000_000)  # usual and longest
_NOTICE_NS = (5_000_000, 600_000_000)
_LOSS = 0.05  # of best-effort messages


@dataclass(frozen=True)
class Quality:
    """What a publisher offers, or a subscription requests."""

    reliability: int
    durability: int
    depth: int


def compatible(offered: Quality, requested: Quality) -> bool:
    """Return True if a publisher offers at least what a subscription requests."""
    reliable = offered.reliability == RELIABLE or requested.reliability == BEST_EFFORT
    durable = offered.durability == TRANSIENT_LOCAL or requested.durability == VOLATILE
    return reliable and durable


@dataclass(eq=False)
class Endpoint:
    """A publisher or subscription as others may know it."""

    process: Process
    node: tuple[str, str]  # name and namespace
    topic: str
    type: str
    quality: Quality
    number: int
    known: set[int] = field(default_factory=set)  # to these processes
    named: set[int] = field(default_factory=set)  # to these its node's name as well
    there: bool = True


@dataclass(eq=False)
class Message:
    data: bytes
    number: int  # of its publisher, from 1
    source_ns: int


@dataclass(eq=False)
class Writer(Endpoint):
    """A publisher's side: what it keeps, and what is under way to each reader."""

    def __post_init__(self) -> None:
        self.sent_ns: list[int] = []  # when each message was sent
        self.kept: deque[Message] = deque(maxlen=max(self.quality.depth, 1))
        self.matched: dict[int, Reader] = {}
        self.under_way: dict[int, deque[Message]] = {}


@dataclass(eq=False)
class Reader(Endpoint):
    """A subscription's side: what has arrived and is not taken yet."""

    def __post_init__(self) -> None:
        self.queue: deque[Message] = deque(maxlen=max(self.quality.depth, 1))
        self.dropped = 0
        self.publishers: set[int] = set()


class Network:
    """All endpoints of the world; what one process knows of them may be old."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.loss = _LOSS
        self.writers: list[Writer] = []
        self.readers: list[Reader] = []
        self.first: dict[str, Callable[[], None]] = {}  # called at a topic's first message
        self._numbers = count(1)
        self._stamps = count(1)
        self._told: dict[tuple[int, int, str], int] = {}  # when the last of them comes

    def writer(self, *values: Any) -> Writer:
        """Add a publisher, which the others discover little by little."""
        one = Writer(*values, next(self._numbers))
        self.writers.append(one)
        self._announce(one)
        return one

    def reader(self, *values: Any) -> Reader:
        """Add a subscription, which the others discover little by little."""
        one = Reader(*values, next(self._numbers))
        self.readers.append(one)
        self._announce(one)
        return one

    def joined(self, process: Process) -> None:
        """Tell a new process, one by one, of all endpoints that are there."""
        for one in (*self.writers, *self.readers):
            if one.there and one.process is not process:
                self._tell(one, process)

    def _announce(self, one: Endpoint) -> None:
        for process in self.world.processes:
            if process is one.process:
                self._learn(one, process, True)
            elif process.alive and process.context is not None:
                self._tell(one, process)

    def _tell(self, one: Endpoint, process: Process) -> None:
        """Let a process learn of an endpoint; those of a kind and of a process come in the order of creation.

        So do the names of their nodes, which arrive separately.
        """
        pair = one.process.number, process.number, type(one).__name__
        at_ns = self.world.now_ns + self.world.delay(*_NOTICE_NS)
        at_ns = self._told[pair] = max(at_ns, self._told.get(pair, 0))
        self.world.at(at_ns - self.world.now_ns, lambda: self._learn(one, process, False))
        names = one.process.number, process.number, "names"
        at_ns += self.world.delay(1_000_000, 200_000_000)
        at_ns = self._told[names] = max(at_ns, self._told.get(names, 0))
        self.world.at(at_ns - self.world.now_ns, lambda: self._name(one, process))

    def until_known_ns(self, process: Process, other: Process) -> int:
        """Return how long it takes until another process has been told of all that a process has now."""
        kinds = (Writer.__name__, Reader.__name__)
        told_ns = (self._told.get((process.number, other.number, kind), 0) for kind in kinds)
        return max(0, *(at_ns - self.world.now_ns for at_ns in told_ns))

    def _name(self, one: Endpoint, process: Process) -> None:
        one.named.add(process.number)

    def _learn(self, one: Endpoint, process: Process, named: bool) -> None:
        if not one.there or not process.alive or process.held or process.number in one.known:
            return
        one.known.add(process.number)
        if named:
            one.named.add(process.number)
        self.world.note("learns", process.name, "of", one.node[0], type(one).__name__, one.topic)
        # With the process's own of the other kind; one of its own with all of that kind.
        for writer in [one] if isinstance(one, Writer) else self.writers:
            for reader in [one] if isinstance(one, Reader) else self.readers:
                other: Endpoint = reader if one is writer else writer
                if other.there and process in (one.process, other.process):
                    self._meet(writer, reader)
        self.world.nudge(process)

    def _meet(self, writer: Writer, reader: Reader) -> None:
        """Match two endpoints as far as each side knows the other."""
        if (writer.topic, writer.type) != (reader.topic, reader.type):
            return
        if not compatible(writer.quality, reader.quality):
            return
        if reader.process.number in writer.known:
            reader.publishers.add(writer.number)
            self._flush(writer, reader)
        if writer.process.number in reader.known and reader.number not in writer.matched:
            writer.matched[reader.number] = reader
            writer.under_way[reader.number] = deque()
            durable = reader.quality.durability == TRANSIENT_LOCAL
            for message in writer.kept if durable else ():
                self._send(writer, reader, message)

    def publish(self, writer: Writer, data: bytes) -> None:
        """Send a message to every subscription that the publisher knows."""
        writer.sent_ns.append(self.world.now_ns)
        if writer.topic in self.first:
            self.first.pop(writer.topic)()
        message = Message(data, len(writer.sent_ns), self.world.now_ns + next(self._stamps))
        writer.kept.append(message)
        for reader in list(writer.matched.values()):
            self._send(writer, reader, message)

    def _send(self, writer: Writer, reader: Reader, message: Message) -> None:
        waiting = writer.under_way[reader.number]
        reliable = reader.quality.reliability == RELIABLE
        deaf = writer.number not in reader.publishers
        if not reliable and (deaf or self.world.random.random() < self.loss):
            return
        waiting.append(message)
        while len(waiting) > max(writer.quality.depth, 1):
            waiting.popleft()
            self.world.note("history full", writer.topic)
        self.world.at(self.world.delay(*LATENCY_NS), lambda: self._arrive(writer, reader, message))

    def _arrive(self, writer: Writer, reader: Reader, message: Message) -> None:
        """Deliver a message and, as order is kept, those before it, to a reader that knows the writer."""
        if not reader.there or reader.process.held or writer.number not in reader.publishers:
            return
        waiting = writer.under_way.get(reader.number)
        if waiting is None or message not in waiting:
            return
        if writer.process.crashed and self.world.random.random() < 0.5:
            return  # the process that would send it again is gone
        while waiting:
            first = waiting.popleft()
            if len(reader.queue) == reader.queue.maxlen:
                reader.dropped += 1
                self.world.note("queue full", reader.node[0], reader.topic)
            reader.queue.append(first)
            if first is message:
                break
        self.world.nudge(reader.process)
        self.world.nudge(writer.process)

    def _flush(self, writer: Writer, reader: Reader) -> None:
        """Send again what came before the subscription knew the publisher."""
        for message in list(writer.under_way.get(reader.number, ())):
            self.world.at(
                self.world.delay(*LATENCY_NS),
                lambda message=message: self._arrive(writer, reader, message),
            )

    def go_on(self, process: Process) -> None:
        """Send again what came while a process was held."""
        for writer in self.writers:
            for reader in writer.matched.values():
                if reader.process is process:
                    self._flush(writer, reader)

    def acknowledged(self, writer: Writer) -> bool:
        """Return True if every known reliable subscription has received all that was sent."""
        return not any(
            waiting
            for number, waiting in writer.under_way.items()
            if (reader := writer.matched[number]).there and reader.quality.reliability == RELIABLE
        )

    def remove(self, one: Endpoint) -> None:
        """Take an endpoint away: others learn of it soon."""
        wait = self.world.delay(1_000_000, 50_000_000)
        one.known.discard(one.process.number)
        self.world.at(wait, lambda: self._forget(one))

    def gone(self, process: Process, wait_ns: int) -> None:
        """Take all of a process away after a time."""
        for one in (*self.writers, *self.readers):
            if one.process is process:
                self.world.at(wait_ns, lambda one=one: self._forget(one))

    def _forget(self, one: Endpoint) -> None:
        one.there = False
        one.known.clear()
        for writer in self.writers:
            writer.matched.pop(one.number, None)
            writer.under_way.pop(one.number, None)
        for reader in self.readers:
            reader.publishers.discard(one.number)
        for process in self.world.processes:
            self.world.nudge(process)

    def known_to(self, process: Process, kind: type[Endpoint], topic: str) -> list[Endpoint]:
        """Return the publishers, or subscriptions, of a topic that a process knows."""
        some = self.writers if kind is Writer else self.readers
        return [one for one in some if one.topic == topic and process.number in one.known]
