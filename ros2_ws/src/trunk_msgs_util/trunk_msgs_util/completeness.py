"""Is a run whole in its recording? `Account`: the one answer, of the recorder and of verification. Pure.

Every process says at its end what it has published, and the simulator how many states there were; what is on
record is held against that. In real time it is also held against what acted on the plant: `ActedRecord`.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import DISTURBANCE, EFFORT_COMMAND, ENDS, INPUT_NAMES, Event, as_count
from trunk_core.units import seconds
from trunk_recording.cdr import frame_in
from trunk_recording.schemas import ParameterChange, RunEvent

from .source import ARRIVAL, source_in, sources_of_inputs

# One message for each state, by the simulator alone.
OF_STATES = (topics.GROUND_TRUTH, topics.JOINT_STATES)
OF_STATES_IN_REAL_TIME = (*OF_STATES, topics.PLANT_INPUTS)
_NO_COMMAND = (
    f"{EFFORT_COMMAND}: no message was recorded, but a torque acted on the plant: "
    "start the recorder before the controller"
)
_RUNS = "it holds {} runs: the simulator was restarted"
_ELSEWHERE = "another node publishes there too"
_COUNTING = (
    *ENDS,
    Event.STARTED,
    Event.CONFIGURED,
    Event.CLEANED_UP,
    Event.CONNECTED,
    Event.PUBLISHED,
)
_NO_CONTROLLER = ("simulator", "disturbance", "reference", "recorder")  # kinds of node


class Account:
    """A run's messages, counted by process and topic, and its events in their order.

    In real time messages name their process. In lock-step none does: there is one for each node.
    What acted on nothing may be missing, if no node of ours has counted it: a stranger's message, or the last
    ones of a node that was killed.
    """

    def __init__(
        self,
        name_of: Callable[[str], str],
        of_each_state: Sequence[str] = OF_STATES,
        sourced: bool = False,
    ) -> None:
        """``name_of`` gives a topic's absolute name; ``of_each_state``: topics that answer every state.

        ``sourced``: messages name their processes.
        """
        self.sourced = sourced
        # By source, which is empty for a stranger's message, and relative topic.
        self.counts: Counter[tuple[str, str]] = Counter()
        self.runs = 1  # by the stamps of the states
        self.driven = False  # did a torque ever act on the plant?
        self.acted = ActedRecord()
        self._name_of = name_of
        self._of_each_state = of_each_state
        self._outlived = False  # did a node's stamps go back?
        self._last_ns: dict[tuple[str, str], int] = {}  # stamps, as `counts`
        self._speaking: set[str] = set()  # nodes with an event on record
        self._events: list[RunEvent] = []  # those that count
        self._parameters: dict[
            str, None
        ] = {}  # nodes whose parameters are on record, in their order

    def take(
        self, topic: str, stamp_ns: int, data: bytes, read: Callable[[bytes], JointSample]
    ) -> None:
        """Take a message that is on record. Raises ValueError for inputs that no simulator of ours sends."""
        if not self.sourced:
            self.counts["", topic] += 1
            return
        frame = frame_in(data)
        source = frame.partition(" ")[0] if topic == topics.PLANT_INPUTS else source_in(frame)
        self.counts[source, topic] += 1
        if topic in (EFFORT_COMMAND, DISTURBANCE) and not self.acted.is_stranger(source):
            # A node that outlived a simulator has messages of its run on record, even if nothing else is.
            self._outlived |= stamp_ns < self._last_ns.get((source, topic), -1)
            self._last_ns[source, topic] = stamp_ns
        if topic == topics.PLANT_INPUTS:
            self.acted.row(read(data), frame)
            return
        self.acted.record(topic, stamp_ns, source)
        if topic == EFFORT_COMMAND and self.acted.is_stranger(source):
            self.acted.record_efforts(read(data).effort)

    def take_event(self, event: RunEvent) -> None:
        """Take an event. Raises ValueError for one that no node of ours sends."""
        counts = event.values if event.message == Event.PUBLISHED else ()
        for name in ("states",) if event.message == Event.FINISHED else counts:
            if as_count(event.values.get(name, "")) < 0:
                raise ValueError(f"{event.message} without a count of {name}")
        self._speaking.add(event.node)
        if event.message in _COUNTING:
            self._events.append(event)

    def take_parameters(self, change: ParameterChange) -> None:
        """Take note of a node that has published its parameters."""
        self._parameters[change.node] = None

    def count(self, topic: str) -> int:
        """Return how many messages there are on a topic, of whomever."""
        return sum(count for (_, name), count in self.counts.items() if name == topic)

    def _kind(self, node: str) -> str:
        """Return the kind of a node, as it reports it; its name if it does not."""
        kinds = (e.values.get("kind") for e in self._events if e.node == node)
        return next(filter(None, kinds), "") or node.rpartition("/")[2]

    def _simulators(self) -> Iterator[RunEvent]:
        nodes = {event.node for event in self._events}
        simulators = {node for node in nodes if self._kind(node) == "simulator"}
        return (event for event in self._events if event.node in simulators)

    @property
    def end(self) -> RunEvent | None:
        """The event with which the simulator ended its last run; None where it has not."""
        end = None
        for event in self._simulators():
            if event.message in ENDS:
                end = event
            elif event.message == Event.STARTED:
                end = None  # the end of the run before is not this one's
        return end

    @property
    def begun(self) -> bool:
        """True if there is a state, or was one, by the simulator's events."""
        started = any(event.message == Event.STARTED for event in self._simulators())
        return started or any(self.count(topic) for topic in OF_STATES)

    @property
    def of_robot(self) -> bool:
        """True for states that no simulator of ours published: such a run has no end that anybody says."""
        return self.begun and not any(self._kind(node) == "simulator" for node in self._parameters)

    def verdict(self, heard: Sequence[str], unheard: Sequence[str] = ()) -> tuple[bool, str]:
        """Return whether the run is whole in the file, and why.

        ``heard``: the topics whose evidence is to be complete; ``unheard``: what could not be heard, a line
        each.
        """
        if (end := self.end) is None:
            until = "was finished" if self.begun else "began: there is no state"
            return False, f"the recorder was stopped before the run {until}"
        reason = end.values.get("reason", end.message)
        if end.message != Event.FINISHED:
            return False, reason
        begun = sum(event.message == Event.STARTED for event in self._simulators())
        if (runs := max(self.runs, begun)) > 1:
            # Of a run before the recorder came, events and commands may be all that the file holds.
            return False, _RUNS.format(runs)
        lacking = next(self._lacking(end, heard, unheard), None)
        return (True, reason) if lacking is None else (False, lacking)

    def _lacking(
        self, end: RunEvent, heard: Sequence[str], unheard: Sequence[str]
    ) -> Iterator[str]:
        """Yield the gaps in the record of a finished run, and messages too many, a line each."""
        states, simulator = as_count(end.values["states"]), end.source if self.sourced else ""
        for topic in self._of_each_state:
            if (count := self.counts[simulator, topic]) < states:
                yield f"{topic}: {count} of {states} messages were recorded"
        for topic in OF_STATES_IN_REAL_TIME if self.sourced else OF_STATES:
            if (count := self.count(topic)) > states:
                yield f"{topic}: {count} messages for {states} states: {_ELSEWHERE}"
        yield from self._too_many()
        if unheard and not self.sourced:
            yield "; ".join(unheard)
        missing = list(self.acted.missing())
        if (missing or self.driven) and not self.count(EFFORT_COMMAND):
            yield _NO_COMMAND
        yield from missing
        for node in (node for node in self._parameters if node not in self._speaking):
            yield f"{node}: its parameters were recorded, but none of its events"
        for (source, topic), count in self._claims(heard).items():
            if (recorded := self.counts[source, topic]) < count:
                yield f"{topic}: {recorded} of {count} messages were recorded"
        if self._outlived:
            yield _RUNS.format(2)

    def _claims(self, heard: Sequence[str] = ()) -> Counter[tuple[str, str]]:
        """Return how many messages each process says it has published, by source and relative topic."""
        known = {self._name_of(topic): topic for topic in (*heard, *(t for _, t in self.counts))}
        claims: Counter[tuple[str, str]] = Counter()
        for event in self._events:
            if event.message == Event.PUBLISHED:
                source = event.source if self.sourced else ""
                for name, count in event.values.items():
                    claims[source, known.get(name, name.lstrip("/"))] += as_count(count)
        return claims

    def _too_many(self) -> Iterator[str]:
        """Yield the topics with more messages of a process than it says; nothing if one began anew."""
        words = Counter((event.node, event.message) for event in self._events)
        claims = self._claims()
        if not claims or any(message == Event.CLEANED_UP for _, message in words):
            return
        uncounted = any(message == Event.CONNECTED for _, message in words) or any(
            words[node, Event.CONFIGURED] > words[node, Event.PUBLISHED]
            for node in {node for node, _ in words}
            if self._kind(node) not in _NO_CONTROLLER
        )
        for (source, topic), count in self.counts.items():
            claimed = claims[source, topic]
            alone = topic == DISTURBANCE or topics.is_controller_state(topic)
            counted = alone or (topic == EFFORT_COMMAND and not uncounted)
            judged = claimed > 0 and (source != "" if self.sourced else counted)
            if topic == topics.OPERATOR_PUSH and not self.sourced:
                judged = True  # a simulator that was never pushed reports no count
            if judged and claimed < count:
                yield f"{topic}: {count} messages, {claimed} of them from its own node: {_ELSEWHERE}"


# A message is named by a row at the latest when it no longer acts; of each topic so many are remembered,
# and so many that are named but not recorded.
_REMEMBERED = 100_000
_COMMAND, _DISTURBANCE = 0, 1  # where a row has their ages


class _Key(NamedTuple):
    """A message: the stamp first, so that older ones compare as smaller."""

    stamp_ns: int
    source: str  # empty: an external node's


class _Messages:
    """What is on record of a topic, the newest, by any key, and what rows have named in vain."""

    def __init__(self) -> None:
        self._recorded: OrderedDict[Any, None] = OrderedDict()
        self._missing: dict[Any, _Key] = {}

    def record(self, key: Any) -> None:
        """Take a message that is on record."""
        self._missing.pop(key, None)
        self._recorded[key] = None
        self._recorded.move_to_end(key)
        if len(self._recorded) > _REMEMBERED:
            self._recorded.popitem(last=False)

    def name(self, key: Any, message: _Key) -> None:
        """Take what a row names."""
        if key in self._recorded:
            self._recorded.move_to_end(key)
        elif len(self._missing) < _REMEMBERED:
            self._missing.setdefault(key, message)

    def rename(self, simulator: str) -> None:
        """Take what was recorded under the simulator's source, before that was known, as a stranger's."""
        for key in [key for key in self._recorded if key.source == simulator]:
            del self._recorded[key]
            self.record(_Key(key.stamp_ns, ""))

    def missing(self) -> list[_Key]:
        """Return the messages that were in force but are not on record, in order."""
        return sorted(self._missing.values())


class ActedRecord:
    """Takes rows, commands and disturbances in any order."""

    def __init__(self) -> None:
        self._topics = {EFFORT_COMMAND: _Messages(), DISTURBANCE: _Messages()}
        self._arrivals = _Messages()  # act from their arrival: a row names their torque alone
        self._simulator = ""  # the rows' source

    def record(self, topic: str, stamp_ns: int, source: str) -> None:
        """Take a message that is on record; the topic may be any."""
        if topic in self._topics:
            named = "" if self.is_stranger(source) else source
            self._topics[topic].record(_Key(stamp_ns, named))

    def is_stranger(self, source: str) -> bool:
        """Return True for a command or disturbance that no node of ours sent.

        Its sender may have copied the state's whole header, and with it the simulator's source.
        """
        return source in ("", self._simulator)

    def record_efforts(self, efforts: Iterable[float]) -> None:
        """Take the torques, N m, of a command that is no node's of ours, on record."""
        for effort in efforts:
            self._arrivals.record(effort)

    def row(self, sample: JointSample, frame_id: str) -> None:
        """Take a row of ``plant/inputs``. Raises ValueError for one that no simulator of ours sends."""
        sources = sources_of_inputs(frame_id)
        if (
            sources is None
            or sample.name != INPUT_NAMES
            or len(sample.velocity) != len(sample.name)
        ):
            raise ValueError("not a row of plant/inputs")
        if self._simulator != sources[0]:
            self._simulator = sources[0]
            for topic in self._topics.values():
                topic.rename(self._simulator)
        ages = sample.velocity[_COMMAND], sample.velocity[_DISTURBANCE]
        for topic, source, age in zip(self._topics.values(), sources[1:], ages, strict=True):
            if age >= 0.0 and source == ARRIVAL:
                self._arrivals.name(sample.position[_COMMAND], _Key(sample.stamp_ns, ""))
            elif age >= 0.0:
                message = _Key(sample.stamp_ns - int(age), source)
                topic.name(message, message)

    def missing(self) -> Iterator[str]:
        """Yield the topics whose messages acted but are not on record, a line each."""
        missing = [(name, topic.missing()) for name, topic in self._topics.items()]
        for name, keys in (*missing, (EFFORT_COMMAND, self._arrivals.missing())):
            if keys:
                stamp_ns, source = keys[0]
                sender = source or "a node that is not ours"
                more = f" (and {len(keys) - 1} more)" if len(keys) > 1 else ""
                yield (
                    f"{name}: a message of {sender} acted on the plant, stamped t = "
                    f"{seconds(stamp_ns):g} s, but was not recorded{more}"
                )
