"""Whether a file is one that our recorder writes: channels, records, and each message's head and bytes.

A recomputation looks at numbers alone. What surrounds them (frames, further statuses, times, sequence
numbers, schemas) decides what other tools show, so it has to be what recorder and nodes write.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from trunk_control.laws import law_named
from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import declarations
from trunk_msgs_util.recording import rosbag2
from trunk_msgs_util.recording.digests import DIGESTS
from trunk_msgs_util.recording.joint_state_cdr import MAX_TRAILING, JointStateLayout
from trunk_msgs_util.recording.messages import head_field, unaligned
from trunk_msgs_util.recording.own_records import END, LIBRARY, PROFILE, PROVENANCE
from trunk_msgs_util.recording.schemas import (
    definition,
    deserialize,
    event,
    parameter_event,
    parse_event,
    parse_parameter_event,
    serialize,
)
from trunk_msgs_util.units import LAST_STAMP_NS, NANOSECONDS, seconds

from ..plans.nodes import CONTROLLERS, NODES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from trunk_msgs_util.recording.file import RecordingFile
    from trunk_msgs_util.recording.joint_arrays import Integers
    from trunk_msgs_util.recording.messages import Messages

    from ..recorded.run import RecordedRun

Parsed = TypeVar("Parsed")

_RECORDS = (PROVENANCE, rosbag2.RECORD, END, DIGESTS)  # of metadata, in their order


def not_as_written(run: RecordedRun, survey: Survey | None = None) -> list[str]:
    """Return what our recorder and nodes would not have written, a line each.

    ``survey`` has taken all messages; without it they are read. Raises RecordingError for messages that
    cannot be read, ParameterError for parameters.
    """
    if survey is None:
        survey = Survey(run)
        for whole, readable in run.recording.survey():
            survey.take(whole, readable)
    found = [line for file in run.recording.opened for line in _around(run, file)]
    found += survey.lines()
    found += _told(run)
    return found


def _around(run: RecordedRun, file: RecordingFile) -> Iterator[str]:
    """Yield what is odd about the file's header, records and channels."""
    if file.profile != PROFILE or not file.library.startswith(LIBRARY):
        yield (
            f"the file's header names profile {file.profile!r} and library {file.library!r}; "
            f"ours has {PROFILE!r} and {LIBRARY!r}"
        )
    names = tuple(name for name, _ in file.metadata_records)
    if names != _RECORDS:
        yield f"metadata records {', '.join(names)}; ours are {', '.join(_RECORDS)}"
    if set(run.recording.end or {}) != {"complete", "reason"}:
        yield f"{END} holds {', '.join(run.recording.end or {})}; ours holds complete, reason"
    if file.attachments:
        yield f"{file.attachments} attachments; ours have none"
    controllers = _controllers(run)
    types = topics.evidence_types(controllers)
    # A single controller's references, and an operator's pushes, have a channel from the first message on.
    own = (*map(topics.own_reference, controllers), topics.OPERATOR_PUSH)
    types |= {name: topics.JOINT_STATE_TYPE for name in own if run.count(name)}
    types |= {name: topics.PICTURES[name] for name in pictures(run)}
    wanted = {run.recording.topic(name): kind for name, kind in types.items()}
    counts = Counter(channel.topic for channel in file.channels.values())
    for topic in sorted({*wanted, *counts}):
        if counts[topic] != (topic in wanted):
            yield f"{topic}: {counts[topic]} channels; ours has {int(topic in wanted)}"
    for channel in file.channels.values():
        schema = file.schemas.get(channel.schema_id)
        kind = wanted.get(channel.topic, "")
        if not kind:
            continue
        if schema is None or (schema.name, schema.encoding) != (kind, "ros2msg"):
            yield f"{channel.topic}: its schema is not {kind} in ros2msg"
        elif schema.data != definition(kind):
            yield f"{channel.topic}: the text of its schema is not that of {kind}"
        if channel.message_encoding != "cdr":
            yield f"{channel.topic}: its messages are not cdr"
        if channel.metadata != rosbag2.channel_metadata(channel.topic, kind):
            yield f"{channel.topic}: its channel's metadata is not what rosbag2 has for it"


def pictures(run: RecordedRun) -> list[str]:
    """Return the topics of the run's picture that are recorded: all of them, or none."""
    if any(run.recording.topic(name) in run.recording.topics for name in topics.PICTURES):
        return list(topics.PICTURES)
    return []


def _controllers(run: RecordedRun) -> tuple[str, ...]:
    """Return the controllers whose terms the recorder has a channel for: the plan's, and who joined."""
    told = run.parameters.get("recorder", {}).get("controllers")
    planned = tuple(map(str, told)) if isinstance(told, tuple) else ()
    planned = planned or tuple(run.recording.provenance.get("controller", "").split())
    open_for = {
        name
        for name in run.joined
        if run.recording.topic(topics.controller_state(name)) in run.recording.topics
    }
    return tuple(
        dict.fromkeys((*planned, *sorted(open_for), *(() if planned else run.controllers)))
    )


class Survey:
    """Takes all messages block by block and notes whose heads or bytes are not ours."""

    def __init__(self, run: RecordedRun) -> None:
        """Raise ParameterError for parameters."""
        self._run = run
        self._counts: Counter[str] = Counter()
        self._times_ns: set[int] = set()
        self._heads: dict[tuple[str, str], str] = {}
        self._layouts = {
            run.recording.topic(relative): (relative, layout)
            for relative, layout in layouts(run).items()
        }
        self._others: dict[str, str] = {}
        self._unstamped = {run.recording.topic(name) for name in topics.PICTURES}

    def passing(
        self, blocks: Iterable[tuple[Mapping[str, Messages], Mapping[str, Messages]]]
    ) -> Iterator[Mapping[str, Messages]]:
        """Take all blocks and pass on what can be read of them."""
        for whole, readable in blocks:
            self.take(whole, readable)
            yield readable

    def take(self, whole: Mapping[str, Messages], readable: Mapping[str, Messages]) -> None:
        """Take a block's messages by topic: all of them, and those that can be read."""
        for topic, messages in whole.items():
            self._take_heads(topic, messages)
        for topic, messages in readable.items():
            if self._run.exact and topic not in self._unstamped:
                self._take_stamps(topic, messages)
            if topic in self._layouts and topic not in self._others:
                self._take_layout(topic, messages)

    def _take_heads(self, topic: str, messages: Messages) -> None:
        """Note sequence numbers or publish times that are not ours, and count the messages."""
        data, offsets, log = messages.data, messages.offsets(), messages.log_time_ns
        times_ns = self._times_ns | {int(log.min()), int(log.max())}
        self._times_ns = {min(times_ns), max(times_ns)}
        sequence = np.arange(self._counts[topic], self._counts[topic] + len(messages))
        self._counts[topic] += len(messages)
        odd = head_field(data, offsets, "sequence") != sequence
        self._note(topic, "the sequence number is not the next", odd, messages)
        odd = head_field(data, offsets, "publish_time") != log.astype(np.uint64)
        self._note(topic, "the publish time is not the log time", odd, messages)

    def _take_stamps(self, topic: str, messages: Messages) -> None:
        """Note log times of simulated time that are not the stamps."""
        what = f"mode {self._run.mode}, but the log time is not the stamp"
        self._note(topic, what, messages.log_time_ns != _stamps(messages), messages)

    def _note(self, topic: str, what: str, odd: NDArray[np.bool_], messages: Messages) -> None:
        if odd.any():
            times_ns = messages.log_time_ns if topic in self._unstamped else _stamps(messages)
            at = seconds(int(times_ns[np.flatnonzero(odd)[0]]))
            self._heads.setdefault((topic, what), f"{topic}: at t = {at:g} s {what}")

    def _take_layout(self, topic: str, messages: Messages) -> None:
        """Note the first message of a topic of the loop with another frame, order of names or length."""
        relative, layout = self._layouts[topic]
        row = _other(messages, layout)
        if row is not None:
            at = seconds(int(_stamps(messages)[row]))
            self._others[topic] = (
                f"{relative}: at t = {at:g} s a message is not as its node writes it: "
                f"{', '.join(layout.name)}, {layout.position} positions, {layout.velocity} "
                f"velocities, {layout.effort} efforts, no frame, nothing else"
            )

    def lines(self) -> list[str]:
        """Return what was noted, a line each, and whether the file's summary is that of its messages."""
        return [
            *self._heads.values(),
            *_summed_up(self._run, self._counts, self._times_ns),
            *(self._others[topic] for topic in self._layouts if topic in self._others),
        ]


def _summed_up(run: RecordedRun, counts: Counter[str], times_ns: set[int]) -> Iterator[str]:
    """Yield where the record for rosbag2's tools does not summarise these messages."""
    for file in run.recording.opened[:1]:
        told = tuple(
            rosbag2.TopicCount(channel.topic, file.type_of(number), counts[channel.topic])
            for number, channel in file.channels.items()
        )
        summary = rosbag2.BagSummary(told, min(times_ns, default=0), max(times_ns, default=0))
        values = dict(file.metadata_records).get(rosbag2.RECORD)
        try:
            expected = rosbag2.summary_record(summary)
        except ValueError:  # a type that ROS 2 does not have
            expected = {}
        if values != expected:
            yield f"the metadata record {rosbag2.RECORD} is not the summary of the messages"


def _stamps(messages: Messages) -> Integers:
    """Return the stamps with which the messages begin, ns, in bounds; 0 for those that are too short."""
    sec, nanosec = unaligned(messages.data, "<i4"), unaligned(messages.data, "<u4")
    long = messages.end - messages.start >= 12
    start = np.where(long, messages.start, 0)
    stamp_ns: Integers = sec[start + 4].astype(np.int64) * NANOSECONDS + nanosec[start + 8]
    return np.where(long, np.clip(stamp_ns, 0, LAST_STAMP_NS), 0)


def layouts(run: RecordedRun) -> dict[str, JointStateLayout]:
    """Return the layout of each topic of the loop that has messages."""
    joints = run.config("simulator").joints
    found = {
        topics.GROUND_TRUTH: JointStateLayout(joints, 2, 2, 2),
        topics.JOINT_STATES: JointStateLayout(joints, 2, 2, 2),
    }
    if run.count(topics.DISTURBANCE):
        found[topics.DISTURBANCE] = JointStateLayout(run.config("disturbance").joints, 2, 0, 2)
    if run.count(topics.OPERATOR_PUSH):
        found[topics.OPERATOR_PUSH] = JointStateLayout(joints, 0, 0, 2)
    for name in run.controllers:
        if name in CONTROLLERS:
            joint = run.config(name).joint
            found[topics.EFFORT_COMMAND] = JointStateLayout((joint,), 0, 0, 1)
            names = law_named(name).record_names
            terms = JointStateLayout(names, len(names))
            found[topics.controller_state(name)] = terms
    return {relative: layout for relative, layout in found.items() if run.count(relative)}


def _other(messages: Messages, layout: JointStateLayout) -> int | None:
    """Return the first message that has another layout; None if all have this one."""
    sizes = messages.end - messages.start
    wrong = np.flatnonzero((sizes < layout.size) | (sizes > layout.size + MAX_TRAILING))
    if len(wrong):
        return int(wrong[0])
    try:
        layout.decode_at(messages.data, messages.start)
    except ValueError:
        for row, start in enumerate(messages.start):
            try:
                layout.decode_at(messages.data, np.array([start]))
            except ValueError:
                return row
    return None


def _told(run: RecordedRun) -> Iterator[str]:
    """Yield events and sets of parameters that hold more than ours do, or are written differently."""
    names = {run.recording.topic(name): name for name in NODES}
    for data in _all(run, topics.RUN_EVENTS):
        told = _readable(parse_event, data)
        if told is None:
            continue
        plain = event(*told)
        if _plain(topics.DIAGNOSTIC_ARRAY_TYPE, data) != plain:
            yield f"run/events: {told.node} {told.message!r}: the message holds more than an event"
    for data in _all(run, topics.RUN_PARAMETERS):
        change = _readable(parse_parameter_event, data)
        if change is None or change.node not in names:
            continue
        declared = declarations(NODES[names[change.node]].config)
        what = f"run/parameters: {change.node} at t = {seconds(change.stamp_ns):g} s"
        unknown = {*change.new, *change.changed} - set(declared)
        if unknown:
            yield f"{what}: it has no parameters {', '.join(sorted(unknown))}"
            continue
        kinds = {name: d.kind for name, d in declared.items()}
        try:
            plain = parameter_event(*change[:4], kinds, change.source)
        except Exception:  # a value that its declared kind cannot hold
            plain = b""
        if _plain(topics.PARAMETER_EVENT_TYPE, data) != plain:
            yield f"{what}: not as the node writes its parameters: types, doubles or more than these"


def _all(run: RecordedRun, relative: str) -> Iterator[bytes]:
    for _, messages in run.recording.messages(run.recording.topic(relative)):
        yield from messages


def _readable(parse: Callable[[bytes], Parsed], data: bytes) -> Parsed | None:
    """Return a message; None if it is malformed, which the reader has reported."""
    try:
        return parse(data)
    except ValueError:
        return None


def _plain(type_name: str, data: bytes) -> bytes:
    """Return the message without the padding between its fields."""
    return serialize(type_name, deserialize(type_name, data))
