"""What is in a recording, as digests: a short one for each topic."""

import struct
from collections.abc import Iterator
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from ros2_ws.src.trunk_runs.test.random_plans import NOT_DRAWN, OF_FUZZY_PID

from trunk_core.parameters.declarations import declarations
from trunk_core.topics import DIAGNOSTIC_ARRAY_TYPE, JOINT_STATE_TYPE, PARAMETER_EVENT_TYPE
from trunk_recording.cdr import JointStateLayout
from trunk_recording.schemas import (
    ParameterChange,
    parameter_event,
    parse_event,
    parse_parameter_event,
)
from trunk_runs.nodes import NODES

_SIZE = 16  # bytes of a digest
_HEAD = struct.Struct("<qI")
# Of a graph, these depend on where and in which process it ran.
_PROCESS, _OUTPUT = "process", "output"
_YOUNGER = (*NOT_DRAWN, *OF_FUZZY_PID)  # parameters than what was frozen
# What the recorder's parameters had then, in their place.
_GONE = {"compression": "zstd", "flush_interval": 0.5}
_DEFAULT_THEN = {("lockstep.timeout", 30.0): 5.0}
_GONE_KINDS = {"compression": "string", "flush_interval": "double"}


class Heard(NamedTuple):
    """A recorded message."""

    topic: str
    kind: str  # its type's name
    log_ns: int
    data: bytes


def messages_of(path: Path) -> Iterator[Heard]:
    """Yield a recording's messages in the order of the file, as far as it can be read."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    kind = schema.name if schema else ""
                    yield Heard(channel.topic, kind, record.log_time, record.data)
        except (McapError, struct.error):  # a killed recorder's file ends anywhere
            return


def digests_of(path: Path, graph: bool) -> dict[str, str]:
    """Return the digest of each topic's log times and messages in their order.

    ``graph``: nodes wrote it. Then digests do not depend on what identifies a process, on the path of the
    file, on the bytes between values, or on the order between the events or parameters of different nodes.
    """
    parts: dict[str, list[tuple[str, int, bytes]]] = {}
    for heard in messages_of(path):
        node, data = _reduced(heard) if graph else ("", _as_frozen(heard))
        parts.setdefault(heard.topic, []).append((node, heard.log_ns, data))
    return {
        topic: _digest(sorted(parts[topic], key=lambda part: part[0])) for topic in sorted(parts)
    }


def _digest(parts: list[tuple[str, int, bytes]]) -> str:
    digest = blake2b(digest_size=_SIZE)
    for _, log_ns, data in parts:
        digest.update(_HEAD.pack(log_ns, len(data)))
        digest.update(data)
    return digest.hexdigest()


def _reduced(heard: Heard) -> tuple[str, bytes]:
    """Return which node an event or parameters are of, and of any message what each graph has alike."""
    if heard.kind == JOINT_STATE_TYPE:
        layout = JointStateLayout.parse(heard.data)
        return "", layout.pack(layout.unpack(heard.data))
    if heard.kind == DIAGNOSTIC_ARRAY_TYPE:
        event = parse_event(heard.data)
        values = {key: value for key, value in event.values.items() if key != _PROCESS}
        return event.node, _without_source(repr(event._replace(values=values)))
    if heard.kind == PARAMETER_EVENT_TYPE:
        change = parse_parameter_event(heard.data)
        new = _as_then(change)
        new.pop(_OUTPUT, None)
        return change.node, _without_source(repr(change._replace(new=new)))
    return "", heard.data


def _as_then(change: ParameterChange) -> dict[str, Any]:
    """Return a node's first parameters as they were when they were frozen."""
    then: dict[str, Any] = {}
    for name, value in change.new.items():
        if name == "scenario":  # of a recorder
            then |= _GONE
        if name not in _YOUNGER:
            then[name] = _DEFAULT_THEN.get((name, value), value)
    return then


def _as_frozen(heard: Heard) -> bytes:
    """Return an offline run's message with the parameters that there were when it was frozen."""
    if heard.kind != PARAMETER_EVENT_TYPE:
        return heard.data
    change = parse_parameter_event(heard.data)
    new = _as_then(change)
    if new == change.new:
        return heard.data
    kinds = {n: d.kind for kind in NODES.values() for n, d in declarations(kind.config).items()}
    kinds |= _GONE_KINDS
    return parameter_event(change.stamp_ns, change.node, new, change.changed, kinds, change.source)


def _without_source(text: str) -> bytes:
    """Return a message as it was before messages of real-time runs named their sources; others have none."""
    return text.replace(", source=''", "").encode()
