"""`CompletenessCheck`: what was recorded of a run against what its nodes report; `Sourced…`: in real time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from .. import topics
from ..events import ENDS, Event, as_count
from ..recording.joint_state_cdr import frame_in
from ..recording.schemas import ParameterChange, RunEvent
from ..source import source_in, sources_of_inputs
from .acted import ActedRecord
from .conversions import WireReader

# One message for each state, by the simulator alone.
OF_STATES = (topics.GROUND_TRUTH, topics.JOINT_STATES)
_OF_STATES_IN_REAL_TIME = (*OF_STATES, topics.PLANT_INPUTS)
NO_COMMAND = (
    f"{topics.EFFORT_COMMAND}: no message was recorded, but a torque acted on the plant: "
    "start the recorder before the controller"
)


class CompletenessCheck:
    """Counts a run's messages, hears its events, and tells whether the recording is whole.

    In lock-step each state has an answer on each of some topics; `SourcedCompletenessCheck` is for real time.
    """

    def __init__(self, name_of: Callable[[str], str], of_each_state: Sequence[str] = ()) -> None:
        """``name_of`` gives a topic's absolute name; ``of_each_state``: topics that answer every state."""
        self._name_of = name_of
        self._of_each_state = of_each_state or OF_STATES
        self.counts: Counter[str] = Counter()  # by relative topic
        self.runs = 1
        self.driven = False  # did a torque ever act on the plant?
        self.end: RunEvent | None = None
        self._kinds: dict[str, str] = {}  # of nodes, as they report them
        self._claimed: Counter[tuple[str, str]] = (
            Counter()
        )  # by source and topic, of nodes that ended
        self._anew = False  # was a node cleaned up? its count then restarts
        self._states = 0  # of a finished run
        self._duration = 0.0  # s, of the run; a robot's has no end either
        self._begun = 0  # runs, as the simulator reports them
        self._silent: dict[str, bool] = {}  # known nodes: has none of their events arrived?

    def take(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Take a message that is on record."""
        self.counts[topic] += 1

    def take_event(self, event: RunEvent) -> None:
        """Take an event. Raises ValueError for one that no node of ours sends."""
        self._silent[event.node] = False
        if event.message == Event.PUBLISHED:
            counts = {(event.source, topic): _count(event, topic) for topic in event.values}
            self._claimed.update(counts)
        self._anew |= event.message == Event.CLEANED_UP
        if event.message == Event.CONFIGURED:
            self._kinds[event.node] = event.values.get("kind", "")
        kind = self._kinds.get(event.node) or event.node.rpartition("/")[2]
        if kind == "simulator" and event.message in ENDS:
            if event.message == Event.FINISHED:
                self._states = _count(event, "states")
            self.end = event
        if kind == "simulator" and event.message == Event.STARTED:
            self.end = None  # the end of the run before is not this one's
            # Of a run before the recorder came, events and commands may be all that the file holds.
            self._begun += 1

    def take_parameters(self, change: ParameterChange) -> None:
        """Take note of a node that has published its parameters."""
        self._silent.setdefault(change.node, True)
        duration = change.new.get("duration", change.changed.get("duration"))
        if duration is not None:  # only a simulator has one
            self._duration = float(str(duration))

    @property
    def goes_on(self) -> bool:
        """True while there is no run, or one that has no end of its own and that nobody has ended yet."""
        begun = self._begun or any(self.counts[topic] for topic in OF_STATES)
        return not begun or (self.end is None and self._duration == 0.0)

    def verdict(self, heard: Sequence[str], unheard: Sequence[str]) -> tuple[bool, str]:
        """Return whether the run is whole in the file, and why.

        ``heard``: the topics whose evidence is to be complete; ``unheard``: what could not be heard, a line
        each.
        """
        if self.end is None:
            return False, "the recorder was stopped before the run was finished"
        reason = self.end.values.get("reason", self.end.message)
        if self.end.message != Event.FINISHED:
            return False, reason
        if (runs := max(self.runs, self._begun)) > 1:
            return False, f"it holds {runs} runs: the simulator was restarted"
        lacking = next(self._lacking(heard, unheard), None)
        return (True, reason) if lacking is None else (False, lacking)

    def _lacking(self, heard: Sequence[str], unheard: Sequence[str]) -> Iterator[str]:
        """Yield the gaps in the record of a finished run."""
        yield from self._without_states(self._of_each_state, OF_STATES)
        for topic in heard:
            # From one node only: the disturbance, a law's terms. Commands may also come from a stranger.
            count = self._claimed["", self._name_of(topic)]
            pushes = topic == topics.OPERATOR_PUSH
            alone = pushes or topic == topics.DISTURBANCE or topics.is_controller_state(topic)
            # A simulator that was never pushed reports no count.
            if alone and not self._anew and (count or pushes) and count < self.counts[topic]:
                yield (
                    f"{topic}: {self.counts[topic]} messages, {count} of them from its own node: "
                    "another node publishes there too"
                )
        if unheard:
            yield "; ".join(unheard)
        if self.driven and not self.counts[topics.EFFORT_COMMAND]:
            yield NO_COMMAND
        yield from self._without_events()
        yield from self._without_messages(heard)

    def _without_states(self, least: Sequence[str], most: Sequence[str]) -> Iterator[str]:
        """Yield the topics with fewer messages than states, and those with more."""
        states = self._states
        for topic in least:
            if (count := self._count_of_run(topic)) < states:
                yield f"{topic}: {count} of {states} messages were recorded"
        for topic in most:
            if self.counts[topic] > states:
                yield (
                    f"{topic}: {self.counts[topic]} messages for {states} states: "
                    "another node publishes there too"
                )

    def _count_of_run(self, topic: str) -> int:
        """Return how many messages there are that may be the run's own."""
        return self.counts[topic]

    def _without_events(self) -> Iterator[str]:
        for node, silent in self._silent.items():
            if silent:
                yield f"{node}: its parameters were recorded, but none of its events"

    def _without_messages(self, heard: Sequence[str]) -> Iterator[str]:
        """Yield the topics with fewer messages than our nodes said they had published."""
        there = {self._name_of(topic): topic for topic in (*heard, *self.counts)}
        for (source, name), count in self._claimed.items():
            topic = there.get(name, name.lstrip("/"))
            if (recorded := self._count_of(source, topic)) < count:
                yield f"{topic}: {recorded} of {count} messages were recorded"

    def _count_of(self, source: str, topic: str) -> int:
        """Return how many messages of a source there are on a topic."""
        return self.counts[topic]


class SourcedCompletenessCheck(CompletenessCheck):
    """Counts the messages of each source, and looks for everything that acted on the plant.

    What acted on nothing may be missing, if no node of ours has counted it: a stranger's message, or the last
    ones of a node that was killed.
    """

    def __init__(self, name_of: Callable[[str], str]) -> None:
        super().__init__(name_of)
        self._of: Counter[tuple[str, str]] = Counter()  # messages, by source and relative topic
        self._acted = ActedRecord()
        self._read_row = WireReader()
        self._read_command = WireReader()

    def take(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Take a message that is on record. Raises ValueError for inputs that no simulator of ours sends."""
        super().take(topic, stamp_ns, data)
        frame = frame_in(data)
        if topic == topics.PLANT_INPUTS:
            self._acted.row(self._read_row(data), frame)
            sources = sources_of_inputs(frame)
            self._of[sources[0] if sources else "", topic] += 1
        else:
            source = source_in(frame)
            self._of[source, topic] += 1
            self._acted.record(topic, stamp_ns, source)
            if topic == topics.EFFORT_COMMAND and self._acted.is_stranger(source):
                self._acted.record_efforts(self._read_command(data).effort)

    def _lacking(self, heard: Sequence[str], unheard: Sequence[str]) -> Iterator[str]:
        yield from self._without_states(_OF_STATES_IN_REAL_TIME, _OF_STATES_IN_REAL_TIME)
        missing = list(self._acted.missing())
        if missing and not self.counts[topics.EFFORT_COMMAND]:
            yield NO_COMMAND
        yield from missing
        yield from self._without_events()
        yield from self._without_messages(heard)

    def _count_of_run(self, topic: str) -> int:
        return self._of[self.end.source if self.end else "", topic]

    def _count_of(self, source: str, topic: str) -> int:
        return self._of[source, topic]


def _count(event: RunEvent, name: str) -> int:
    """Return a count that an event gives. Raises ValueError if it is none: no node of ours sent it."""
    count = as_count(event.values.get(name, ""))
    if count < 0:
        raise ValueError(f"{event.message} without a count of {name}")
    return count
