"""The ``recorder`` node: every topic of a run, as it came over the wire, into one MCAP file."""

from __future__ import annotations

import struct
import time
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import get_rmw_implementation_identifier
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_core.parameters.declarations import ParameterError
from trunk_core.parameters.shared import RecorderConfig
from trunk_core.samples import JointSample
from trunk_core.text import printable
from trunk_core.topics import JOINT_STATE_TYPE, Event
from trunk_core.units import LAST_STAMP_NS, NANOSECONDS, nanoseconds
from trunk_recording import provenance
from trunk_recording.cdr import frame_in
from trunk_recording.schemas import ParameterChange, parse_event, parse_parameter_event
from trunk_recording.writer import PROVENANCE, RecordingWriter

from ..completeness import OF_STATES_IN_REAL_TIME, Account
from ..picture.film import Film, value
from ..source import process_id, process_of, source_in
from . import discovery, qos
from .base import TrunkNode
from .conversions import WireReader, sample_to_wire
from .execution import main_for

_MESSAGES: dict[str, type[Any]] = {
    topics.JOINT_STATE_TYPE: JointState,
    topics.PARAMETER_EVENT_TYPE: ParameterEvent,
    topics.DIAGNOSTIC_ARRAY_TYPE: DiagnosticArray,
}
# Every recorded type begins with a stamp, right after the four bytes of encapsulation.
_STAMP = struct.Struct("<iI")
# What happens to the nodes, the recorder included, is written even while it is inactive.
_ALWAYS = (topics.RUN_PARAMETERS, topics.RUN_EVENTS)
# In lock-step, a node that publishes something else there is one that the run lacks.
_OF_THE_LOOP = (
    topics.GROUND_TRUTH,
    topics.JOINT_STATES,
    topics.EFFORT_COMMAND,
    topics.DISTURBANCE,
)
# When told to end, it goes on until nothing has arrived for this long and for this many turns: a busy machine
# may take that long between two turns.
_QUIET_S = 0.3
_QUIET_TURNS = 10
# ... but no longer than this if the run goes on without it.
_LEAVE_S = 0.7
_TELL_EVERY = 50  # states
_FOLLOW_S = 0.05
_CHECK_S = 0.1
_FLUSH_S = 0.5  # a killed recorder loses no more than that
# In lock-step nothing waits for the recorder, within its window: waking it for each message would cost
# the loop more than the recording does.
_LINGER_S = 0.01
_TELL_S = 0.02
# A stranger's publisher keeps few messages: the plant waits for the recorder sooner, so it must not linger.
_LINGER_BESIDE_STRANGERS_S, _TELL_STRANGERS_S = 0.003, 0.003

Info: TypeAlias = Mapping[str, Any]  # what the middleware reports about a message
Kind: TypeAlias = tuple[ReliabilityPolicy, DurabilityPolicy]

# Twice what a publisher of evidence keeps: one that is matched late delivers all of it at once.
_REMEMBERED = 2 * qos.EVIDENCE_DEPTH
# A publisher whose node is still unknown after this many looks counts as external.
_UNNAMED_LOOKS = 20

_SUFFIX = ".mcap"


class _Remembered:
    """Counts messages whose other copy is still to come, the newest ones."""

    def __init__(self) -> None:
        self._counts: OrderedDict[Hashable, int] = OrderedDict()

    def add(self, key: Hashable) -> None:
        """Note one more."""
        self._counts[key] = self._counts.get(key, 0) + 1
        if len(self._counts) > _REMEMBERED:
            self._counts.popitem(last=False)

    def take(self, key: Hashable) -> bool:
        """Return True if there is one, which is then done."""
        count = self._counts.pop(key, 0)
        if count > 1:
            self._counts[key] = count - 1
        return count > 0

    def __contains__(self, key: Hashable) -> bool:
        return key in self._counts


class RecordedSubscription:
    """Each message of a topic once, from any publisher, whatever its quality of service.

    DDS matches a subscription only with publishers that offer at least what it requests. Our nodes keep
    what they publish for a recorder that joins late, on a separate topic (`topics.evidence`). Others
    publish only on the live topic: rclpy and `ros2 topic pub` are volatile by default, and a sensor is
    often best effort. No single subscription serves all of them: one that requests past messages does not
    match volatile publishers, one that does not misses the past. So there is one more for each kind that
    some other publisher offers, just as rosbag2 adapts to what is offered. A message that several
    subscriptions receive has the same time and number in each, and is taken once.

    Such a subscription also hears our nodes' live copies. They have the number and the bytes of the kept
    ones; in real time they also name their source, and one whose messages are kept is not heard there.

    ``other_types`` has the nodes that publish something else there.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        type_name: str,
        message_type: Any,
        take: Callable[[bytes], None],
    ) -> None:
        """Subscribe; ``take`` gets each message."""
        self._node = node
        self._topic = topic
        self._type_name = type_name
        self._message_type = message_type
        self._take = take
        self.other_types: dict[str, str] = {}
        self._sources: set[str] = set()  # of messages that are kept
        self._passed: OrderedDict[Hashable, None] = OrderedDict()
        # Our nodes publish each message twice: here are those taken once, whose other copy is still to come.
        self._kept_alone = _Remembered()
        self._live_alone = _Remembered()
        self._passing: dict[Kind, Subscription] = {}
        self._looked_at = (0, 0)
        self._unnamed_looks = 0
        self._read = WireReader()
        self._kept_topic = topics.evidence(node.resolve_topic_name(topic))
        self._kept = self._subscribe(self._kept_topic, qos.evidence(), self._on_kept)

    def _subscribe(
        self, topic: str, profile: QoSProfile, on_message: Callable[..., None]
    ) -> Subscription:
        return self._node.create_subscription(
            self._message_type,
            topic,
            on_message,
            profile,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda _: self.look()),
        )

    @property
    def publisher_count(self) -> int:
        """The number of matched publishers of the subscription that has most."""
        subscriptions = (self._kept, *self._passing.values())
        return max(subscription.get_publisher_count() for subscription in subscriptions)

    @property
    def by_strangers(self) -> bool:
        """True if nodes that keep no evidence publish there, too."""
        return bool(self._passing)

    def look(self) -> None:
        """Subscribe once more for a publisher that no subscription receives; cheap if none is new."""
        counts = (self._node.count_publishers(self._topic), self._kept.get_publisher_count())
        if counts == self._looked_at:
            return
        self._looked_at = counts
        keep = discovery.publishers(self._node, self._kept_topic)
        for endpoint in self._node.get_publishers_info_by_topic(self._topic):
            name = discovery.names([endpoint])[0]
            if name in keep:
                continue
            if name.endswith(topics.UNKNOWN_NODE) and self._unnamed_looks < _UNNAMED_LOOKS:
                self._unnamed_looks += 1
                self._looked_at = (-1, -1)  # look again
            elif endpoint.topic_type != self._type_name:
                self._note_type(name, endpoint.topic_type)
            else:
                self._hear_passing(_kind(endpoint))

    def _note_type(self, node: str, type_name: str) -> None:
        if node not in self.other_types:
            self.other_types[node] = type_name
            self._node.get_logger().warning(f"nobody receives it: {self.of_other_types()[-1]}")

    def _hear_passing(self, kind: Kind) -> None:
        if kind in self._passing:
            return

        def on_message(data: bytes, info: Info) -> None:
            self._on_passing(data, info, kind)

        profile = QoSProfile(depth=qos.EVIDENCE_DEPTH, reliability=kind[0], durability=kind[1])
        self._passing[kind] = self._subscribe(self._topic, profile, on_message)

    def _on_kept(self, data: bytes, info: Info) -> None:
        """Take a message of a node of ours, unless a copy of it was taken."""
        source = source_in(frame_in(data))
        if source:  # also for copies that are heard from later on
            self._sources.add(source)
        if self._passing:
            key = self._key(data, info, source)
            if self._live_alone.take(key):
                return
            if not source:
                self._kept_alone.add(key)
        self._take(data)

    def _on_passing(self, data: bytes, info: Info, kind: Kind) -> None:
        """Take a message of any publisher that offers as much as this subscription requests.

        A message has the same source time in every subscription that hears it.
        """
        source = source_in(frame_in(data))
        if source in self._sources:
            return
        sample = info["source_timestamp"], info["publication_sequence_number"], data
        if sample in self._passed:
            return
        self._passed[sample] = None
        if len(self._passed) > _REMEMBERED:
            self._passed.popitem(last=False)
        # Only volatile ones hear our nodes' live copies; somebody's copy, of any kind, names the source.
        if source or kind[1] == DurabilityPolicy.VOLATILE:
            key = self._key(data, info, source)
            if self._kept_alone.take(key):
                return
            # Somebody's copy can overtake the first message that is kept, which names the source.
            unheard = self._kept.get_publisher_count() > len(self._sources)
            if source and unheard and key in self._live_alone:
                return
            self._live_alone.add(key)
        self._take(data)

    def _key(self, data: bytes, info: Info, source: str) -> Hashable:
        """Return what a message has in common with its copies: in somebody's, the padding is arbitrary."""
        if source:
            data = sample_to_wire(self._read(data), source)
        return info["publication_sequence_number"], data

    def of_other_types(self) -> list[str]:
        """Return who publishes something else there, which nobody receives, a line each."""
        return [
            f"{self._topic}: {name} publishes {other} there, not {self._type_name}"
            for name, other in sorted(self.other_types.items())
        ]


def _kind(endpoint: TopicEndpointInfo) -> Kind:
    """Return the kind that a publisher offers; durability without reliability counts as volatile."""
    offered = endpoint.qos_profile
    if offered.reliability == ReliabilityPolicy.RELIABLE:
        return offered.reliability, offered.durability
    return offered.reliability, DurabilityPolicy.VOLATILE


def open_output(config: RecorderConfig) -> RecordingWriter:
    """Create the file. Raises ParameterError if it cannot be written or already exists."""
    path = Path(config.output or time.strftime(f"trunk_%Y%m%dT%H%M%SZ{_SUFFIX}", time.gmtime()))
    if path.suffix.lower() != _SUFFIX and not path.is_relative_to("/dev"):
        raise _refused(path, f"the file's name must end in {_SUFFIX}, such as {path / 'run.mcap'}")
    try:
        return RecordingWriter(path, overwrite=config.overwrite)
    except FileExistsError:
        way_out = "it exists: give another name, or -p overwrite:=true to replace it"
        raise _refused(path, way_out) from None
    except OSError as error:
        raise _refused(path, f"a file to write ({error})") from None


def _refused(path: Path, allowed: str) -> ParameterError:
    return ParameterError("output", str(path), allowed)


_TERMS = "terms"  # those of the controller heard last
_OF_A_PLANT = "initial.position"  # a parameter that no other node has


class Pictures:
    """What a recorder hears, as the pictures that it records for 3-D views.

    Keeps the newest message of what a picture shows, as bytes; only what is drawn is parsed.
    """

    def __init__(self) -> None:
        self._film = Film()
        self._plant = ""  # its node
        self._newest: dict[str, bytes] = {}
        self._read: defaultdict[str, WireReader] = defaultdict(WireReader)

    def taking(self, topic: str) -> Callable[[bytes], None] | None:
        """Return the function that takes a topic's messages; None for a topic that no picture shows."""
        if topic == topics.DISTURBANCE:
            return partial(self._newest.__setitem__, topic)
        if topics.is_controller_state(topic):
            return partial(self._newest.__setitem__, _TERMS)
        return None

    def reconfigure(self, change: ParameterChange) -> str:
        """Take a node's parameters; return why a new plant is not drawn, empty if it is."""
        if _OF_A_PLANT in change.new:
            self._plant = change.node
        if change.node != self._plant:
            return ""
        return self._film.reconfigure(change.new, change.changed)

    def picture(self, stamp_ns: int, truth: bytes, log_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield the topics and messages of a true state's picture; none for a state that is not drawn.

        One that comes before the plant is known leaves its turn to the next.
        """
        if not self._film.is_due(stamp_ns) or self._film.geometry is None:
            return
        read = {name: self._read[name](data) for name, data in self._newest.items()}
        state = self._read[topics.GROUND_TRUTH](truth)
        reference = value(read.get(_TERMS), "position", "reference")
        yield from self._film.picture(state, read.get(topics.DISTURBANCE), reference, log_ns)


class RecorderNode(TrunkNode[RecorderConfig]):
    """Subscribes to the evidence as serialized bytes and writes them unchanged."""

    def __init__(self) -> None:
        super().__init__("recorder", RecorderConfig)
        self._file: RecordingWriter | None = None
        self._read: defaultdict[str, WireReader] = defaultdict(WireReader)  # by topic
        self._forget()

    def _forget(self) -> None:
        self._last_message = time.monotonic()
        self._leaving_s: float | None = None
        self._quiet_turns = 0
        lockstep = self.config.lockstep
        of_each_state = self.config.lockstep_topics if lockstep else OF_STATES_IN_REAL_TIME
        self._account = Account(self.resolve_topic_name, of_each_state, sourced=not lockstep)
        self._written_ns = dict.fromkeys(self.config.lockstep_topics, -1)
        self._told_ns = -1
        self._looked_at = 0
        self.run_stamp_ns = -1
        self._recorded: dict[str, RecordedSubscription] = {}
        self._pictures = Pictures() if self.config.markers else None

    def set_up(self) -> None:
        """Open the file. Raises ParameterError if it cannot be written or already exists."""
        config = self.config
        self._forget()
        self.unfinished = ""
        self._file = file = open_output(config)
        self._begin(file)
        self._progress = self.create_publisher(JointState, topics.RECORDER_PROGRESS, qos.latest())
        self._flush_timer = self.every(_FLUSH_S, partial(self._flush, file))
        self._check_timer = self.every(_CHECK_S, partial(self._check, file))
        if config.lockstep:
            self.linger_s = _LINGER_S
            self._progress_timer = self.every(_TELL_S, self._tell_progress)
        self.get_logger().info(f"recording to {printable(str(file.path))}")

    @contextmanager
    def _to_disk(self) -> Iterator[None]:
        """Report a failed write in the body of a ``with``, once: the recording ends there."""
        try:
            yield
        except OSError as error:
            self._end_recording(error)

    def _end_recording(self, error: OSError) -> None:
        if self.exit_code is None:
            self.fail(f"{error.filename}: cannot write: {error.strerror}; the recording ends here")

    def _flush(self, file: RecordingWriter) -> None:
        """Hand what was written over to the system, and have the disk take it while the loop goes on."""
        with self._to_disk():
            file.flush()
            file.sync_beside()

    def _check(self, file: RecordingWriter) -> None:
        """Detect early that the file was deleted, renamed, replaced or truncated, or is not on the disk."""
        with self._to_disk():
            file.check()

    def _begin(self, file: RecordingWriter) -> None:
        config = self.config
        origin = provenance.gather(
            scenario=config.scenario,
            controller=" ".join(config.controllers),
            mode=config.mode,
            rmw=get_rmw_implementation_identifier(),
            process=process_id(),
        )
        pictures = topics.PICTURES if self._pictures is not None else {}
        with self._to_disk():
            file.add_metadata(PROVENANCE, origin)
        self._channels = {
            topic: file.channel(self.resolve_topic_name(topic), type_name)
            for topic, type_name in (self._evidence_types() | pictures).items()
        }
        self._flush(file)

    def _write(self, topic: str, log_ns: int, data: bytes) -> bool:
        """Write a message; return False if the disk failed. A topic not met before holds joint states."""
        file = self._file
        assert file is not None  # for the type: `set_up` made it
        if topic not in self._channels:
            name = self.resolve_topic_name(topic)
            self._channels[topic] = file.channel(name, JOINT_STATE_TYPE)
        try:
            file.write(self._channels[topic], log_ns, log_ns, data)
        except OSError as error:
            self._end_recording(error)
            return False
        return True

    def _evidence_types(self) -> dict[str, str]:
        return topics.evidence_types(self.config.controllers, self.config.mode)

    def activate(self) -> None:
        """Subscribe, the first time; earlier messages come too, from the publishers' history."""
        if not self._recorded:
            types = self._evidence_types()
            # Last: whose parameters are on record knows then that the rest is heard, too, and waits for it.
            parameters = {topics.RUN_PARAMETERS: types.pop(topics.RUN_PARAMETERS)}
            for topic, type_name in (types | parameters).items():
                self._subscribe(topic, type_name)
            self._follow_timer = self.every(_FOLLOW_S, self._follow)
            self._ready_timer = self.every(0.02, self._announce)

    def _follow(self) -> None:
        """Subscribe to what is new: every publisher, and each node in this namespace that has a ``~/state``.

        From then on, such a node's own references are heard too, and an operator's pushes if the simulator
        takes any.
        """
        for subscription in list(self._recorded.values()):
            subscription.look()
        if self.config.lockstep and any(
            self._recorded[topic].by_strangers for topic in self.config.lockstep_topics
        ):  # the plant then leaves it few steps
            self.linger_s = _LINGER_BESIDE_STRANGERS_S
            self._progress_timer.timer_period_ns = nanoseconds(_TELL_STRANGERS_S)
        prefix = f"{self.get_namespace().rstrip('/')}/"
        for name, types in self.get_topic_names_and_types():
            relative = name.removeprefix(prefix)
            if (
                name.startswith(prefix)
                and (topics.is_controller_state(relative) or relative == topics.OPERATOR_PUSH)
                and topics.JOINT_STATE_TYPE in types
                and relative not in self._recorded
                and self._file is not None
            ):
                self._subscribe(relative, topics.JOINT_STATE_TYPE)

    def _announce(self) -> None:
        """Report ready once every topic of the loop that the plant waits for has a publisher."""
        wanted = self.config.lockstep_topics if self.config.lockstep else ()
        if all(self._recorded[topic].publisher_count for topic in wanted):
            self._ready_timer.cancel()
            self.event(Event.READY, answers="recorder")

    def tear_down(self) -> None:
        """Finish the file."""
        self._finish()

    def _subscribe(self, topic: str, type_name: str) -> None:
        take = self._callback(topic)
        if topic in _ALWAYS:
            self.create_subscription(
                _MESSAGES[type_name], topic, take, qos.run_information(), raw=True
            )
        elif topic == topics.PLANT_INPUTS:  # by our simulator alone, for the recorder alone
            kept = topics.evidence(self.resolve_topic_name(topic))
            self.create_subscription(_MESSAGES[type_name], kept, take, qos.evidence(), raw=True)
        else:
            self._recorded[topic] = RecordedSubscription(
                self, topic, type_name, _MESSAGES[type_name], take
            )
        if topics.is_controller_state(topic):
            own = topics.own_reference(topic.partition("/")[0])
            self._subscribe(own, topics.JOINT_STATE_TYPE)

    def _callback(self, topic: str) -> Callable[[bytes], None]:
        on_message: Callable[[bytes], None] | None = {
            topics.RUN_EVENTS: self._on_event,
            topics.RUN_PARAMETERS: self._on_change,
            topics.GROUND_TRUTH: self._on_truth,
        }.get(topic)
        if self._pictures is not None and on_message is None:
            on_message = self._pictures.taking(topic)
        lockstep = self.config.lockstep

        def write(data: bytes) -> None:
            try:
                sec, nanosec = _STAMP.unpack_from(data, 4)
            except struct.error:
                self.refuse("messages too short", f"on {topic}: {len(data)} bytes have no stamp")
                return
            stamp_ns = min(sec * NANOSECONDS + nanosec, LAST_STAMP_NS)
            log_time = max(stamp_ns, 0) if lockstep else time.time_ns()
            if not (self.active or topic in _ALWAYS):
                self.counters["messages not recorded while inactive"] += 1
                return
            if not self._write(topic, log_time, data):
                return
            try:
                self._account.take(topic, stamp_ns, data, self._read[topic])
            except ValueError as error:
                self.refuse(f"messages malformed on {topic}", str(error))
            if topic == topics.EFFORT_COMMAND:
                # After a swap two nodes give commands, and those of the first may arrive last.
                stamp_ns = max(stamp_ns, self._written_ns.get(topic, -1))
            self._written_ns[topic] = stamp_ns
            self._last_message, self._quiet_turns = time.monotonic(), 0
            if on_message is not None:
                on_message(data)

        return write

    def _on_truth(self, data: bytes) -> None:
        before_ns, self.run_stamp_ns = self.run_stamp_ns, self._written_ns[topics.GROUND_TRUTH]
        account = self._account
        account.runs += self.run_stamp_ns < before_ns
        if self.config.lockstep and account.counts["", topics.GROUND_TRUTH] % _TELL_EVERY == 0:
            self._tell_progress()
        if self.config.lockstep and not account.driven:
            account.driven = any(
                self._read[topics.GROUND_TRUTH](data).effort[1:]
            )  # the first is the hip's
        if self._pictures is not None:
            self._draw(self._pictures, data)

    def _draw(self, pictures: Pictures, truth: bytes) -> None:
        """Record the picture of a true state, if it is one that is drawn."""
        log_ns = max(self.run_stamp_ns, 0) if self.config.lockstep else time.time_ns()
        for topic, data in pictures.picture(self.run_stamp_ns, truth, log_ns):
            self._write(topic, log_ns, data)

    def _tell_progress(self) -> None:
        """Tell the simulator up to which stamp every topic of the loop is in the file."""
        written_ns = min(self._written_ns[topic] for topic in self.config.lockstep_topics)
        if written_ns != self._told_ns:  # it goes back if the simulator restarts
            self._told_ns = written_ns
            self._progress.publish(sample_to_wire(JointSample(written_ns, ("recorder",))))

    def _on_change(self, data: bytes) -> None:
        try:
            change = parse_parameter_event(data)
        except ValueError as error:
            self.refuse("parameters malformed", str(error))
            return
        if self.is_second(change.node, process_of(change.source)):
            return
        self._account.take_parameters(change)
        if self._pictures is not None and (problem := self._pictures.reconfigure(change)):
            self.get_logger().warning(printable(problem))

    def _on_event(self, data: bytes) -> None:
        try:
            event = parse_event(data)
            process = process_of(event.source) or event.values.get("process", "")
            if not self.is_second(event.node, process):
                self._account.take_event(event)
        except ValueError as error:
            self.refuse("events malformed", str(error))
            return
        self.look_for_duplicate(event.node, event.message, event.values)

    def waits_for(self) -> discovery.Wait:
        """Return the reason why a recorder hears nothing, and how to end one whose run is over."""
        if not self.active:
            return discovery.Wait()
        if self._account.end is not None:
            return discovery.Wait(
                "Ctrl-C: the run is over; stop the controllers first: then they report their counts"
            )
        before, self._looked_at = self._looked_at, self._account.count(topics.JOINT_STATES)
        if self._looked_at > before:
            return discovery.Wait()
        topic = self.resolve_topic_name(topics.JOINT_STATES)
        last_ns = self._written_ns.get(topics.JOINT_STATES, -1)
        publishers = discovery.described_publishers(self, topic)
        return discovery.states(topic, publishers, last_ns if self._looked_at else None, {})

    def diagnostics(self) -> dict[str, object]:
        """Return the file and the number of its messages."""
        if self._file is None:
            return {"messages": 0}
        return {"file": self._file.path, "messages": self._account.counts.total()}

    def account(self) -> None:
        """Expect what the other nodes of this process have just reported."""
        super().account()
        self._last_message, self._leaving_s = time.monotonic(), None

    def draining(self) -> bool:
        """Return True while messages that were in flight when it was told to end still arrive."""
        now = time.monotonic()
        # What came while it was kept from its turn is still to be taken.
        if self._leaving_s is None:
            self._leaving_s = self._last_message = now
        self._quiet_turns += 1
        if self._account.end is None and now - self._leaving_s > _LEAVE_S:
            return False
        return now - self._last_message < _QUIET_S or self._quiet_turns <= _QUIET_TURNS

    def verdict(self) -> tuple[bool, str]:
        """Return whether the run is whole in the file, and why."""
        unheard = [
            line
            for topic, subscription in self._recorded.items()
            if topic in _OF_THE_LOOP
            for line in subscription.of_other_types()
        ]
        return self._account.verdict(list(self._recorded), unheard)

    def _finish(self) -> None:
        if (file := self._file) is None:
            return
        complete, reason = self.verdict()
        if not complete and not self._account.of_robot:
            self.unfinished = reason
        with self._to_disk():
            file.finish(complete=complete, reason=reason, sync=True)
            count = sum(topic.messages for topic in file.summary().topics)
            written = printable(f"recorded: {file.path}, {count} messages")
            if complete:
                self.get_logger().info(f"{written}, complete ({printable(reason)})")
            else:
                self.get_logger().warning(f"{written}, INCOMPLETE: {printable(reason)}")
        self._file = None

    def close(self) -> None:
        """Take in what is in flight, finish the file, then end."""
        self._finish()
        super().close()


main = main_for(RecorderNode, "recorder")
