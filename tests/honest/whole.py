"""What a file that is marked as complete lacks, by other readers than ours: mcap and rosbags."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

_STORE = get_typestore(Stores.ROS2_JAZZY)
_STATES = ("/plant/inputs", "/ground_truth/joint_states", "/joint_states")
_COMMANDS, _DISTURBANCES = "/effort_command", "/disturbance"
_NOBODY = "-"
NS = 1_000_000_000


class Message(NamedTuple):
    """A message of a joint topic."""

    stamp_ns: int
    source: str
    values: Any


class Content:
    """A file's messages by topic, and what its metadata says."""

    def __init__(self, path: Path) -> None:
        self.joints: dict[str, list[Message]] = defaultdict(list)
        self.events: list[tuple[str, str, str, dict[str, str]]] = []  # source, node, word, values
        self.parameters: list[tuple[str, str, dict[str, Any]]] = []  # source, node, values
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            self.metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                assert schema is not None
                self._take(channel.topic, _STORE.deserialize_cdr(message.data, schema.name))

    def _take(self, topic: str, message: Any) -> None:
        if topic == "/run/events":
            for status in message.status:
                values = {pair.key: pair.value for pair in status.values}
                source = message.header.frame_id
                self.events.append((source, status.name, status.message, values))
        elif topic == "/run/parameters":
            source = next((p.name for p in message.deleted_parameters), "")
            both = (*message.new_parameters, *message.changed_parameters)
            values = {p.name: _value(p.value) for p in both}
            self.parameters.append((source, message.node, values))
        else:
            header = message.header
            stamp_ns = header.stamp.sec * NS + header.stamp.nanosec
            self.joints[topic].append(Message(stamp_ns, header.frame_id, message))

    @property
    def complete(self) -> bool:
        """True if the file is marked as complete."""
        return self.metadata.get("trunk_end", {}).get("complete") == "true"


def _value(value: Any) -> Any:
    fields = ("", "bool", "integer", "double", "string", "byte_array")
    arrays = ("bool_array", "integer_array", "double_array", "string_array")
    if value.type == 0:
        return None
    held = getattr(value, f"{(*fields, *arrays)[value.type]}_value")
    return tuple(held) if value.type > 4 else held


def lacking(content: Content, changes: Mapping[str, Sequence[Mapping[str, Any]]]) -> Iterator[str]:
    """Yield what a complete recording lacks; ``changes``: those that each node's process has accepted."""
    ends = [e for e in content.events if e[2] == "finished" and e[1].endswith("simulator")]
    if len(ends) != 1:
        yield f"{len(ends)} events 'finished' of a simulator"
        return
    simulator, node, _, values = ends[0]
    rate = next(v["update_rate"] for _, n, v in content.parameters if n == node)
    period_ns = round(NS / rate)
    expected = Counter(k * period_ns for k in range(int(values["states"])))
    for topic in _STATES:
        stamps = Counter(m.stamp_ns for m in content.joints[topic] if _of(m, topic) == simulator)
        if lost := expected - stamps:
            yield f"{topic}: {lost.total()} states without a message, the first at {min(lost)} ns"
        if more := stamps - expected:
            yield f"{topic}: {more.total()} messages too many, the first at {min(more)} ns"
    yield from _unnamed(content)
    yield from _uncounted(content)
    yield from _unchanged(content, changes)


def _of(message: Message, topic: str) -> str:
    return message.source.split(" ")[0] if topic == "/plant/inputs" else message.source


def _unnamed(content: Content) -> Iterator[str]:
    """Yield rows of ``plant/inputs`` that name what is not there."""
    sent: dict[str, set[tuple[int, str, tuple[float, ...]]]] = {}
    for topic in (_COMMANDS, _DISTURBANCES):
        sent[topic] = set()
        for stamp_ns, source, message in content.joints[topic]:
            efforts, offsets = tuple(message.effort.tolist()), tuple(message.position.tolist())
            numbers = efforts if topic == _COMMANDS else efforts + offsets
            sent[topic].add((stamp_ns, source if "@" in source else _NOBODY, numbers))
    lost: Counter[str] = Counter()
    first: dict[str, str] = {}
    for stamp_ns, frame, row in content.joints["/plant/inputs"]:
        _, *sources = frame.split(" ")
        for topic, source, columns in zip(sent, sources, (slice(0, 1), slice(1, 5)), strict=True):
            age, acting = row.velocity[columns][0], tuple(row.position[columns].tolist())
            key = (stamp_ns - int(age), source, acting)
            if key in sent[topic] or (age < 0.0 and source == _NOBODY and not any(acting)):
                continue
            lost[topic] += 1
            first.setdefault(topic, f"at {stamp_ns} ns: {key}")
    for topic, count in lost.items():
        yield f"{topic}: {count} rows name what is not recorded, {first[topic]}"


def _uncounted(content: Content) -> Iterator[str]:
    """Yield topics with fewer messages than their publishers counted."""
    there = Counter((_of(m, topic), topic) for topic, all_ in content.joints.items() for m in all_)
    for source, _, word, values in content.events:
        for topic, count in values.items() if word == "published" else ():
            if there[source, topic] < int(count):
                yield f"{topic}: {there[source, topic]} of {count} messages of {source}"


def _unchanged(
    content: Content, changes: Mapping[str, Sequence[Mapping[str, Any]]]
) -> Iterator[str]:
    """Yield changes of parameters that a node's process has accepted, but that are not on record."""
    for node, accepted in changes.items():
        recorded = [values.items() for _, name, values in content.parameters if name == f"/{node}"]
        for values in accepted:
            if not any(values.items() <= items for items in recorded):
                yield f"run/parameters: {node} accepted {dict(values)}"
