"""`Recording`: what an MCAP file of a run says, as far as the file is sound."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from . import topics as names
from .joint_arrays import JointArrays, concatenate, decode
from .mcap_blocks import (
    MAGIC,
    ChecksumError,
    Content,
    DamageError,
    Record,
    content_of,
    damaged,
    read_record,
    records,
)
from .recording_writer import DIGESTS, END, PROVENANCE
from .schemas import ParameterChange, RunEvent, parse_event, parse_parameter_event
from .units import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .declarations import Value

Parsed = TypeVar("Parsed")

_BLOCKS = (Opcode.CHUNK, Opcode.MESSAGE)
# These types begin with a stamp, right behind the encapsulation.
_STAMPED = (
    names.JOINT_STATE_TYPE,
    names.PARAMETER_EVENT_TYPE,
    names.DIAGNOSTIC_ARRAY_TYPE,
    names.CLOCK_TYPE,
)


class RecordingError(ValueError):
    """The file cannot be used as a recording: one line that names it and says what to do."""


@dataclass
class Topic:
    """What the file holds of a topic; stamps are the headers', or else the log times."""

    type: str
    count: int = 0
    first_stamp_ns: int | None = None
    last_stamp_ns: int | None = None
    size: int = 0  # encoded bytes


class Recording:
    """A run's file, scanned once; messages are read from it when they are asked for.

    ``warnings`` says what is missing or damaged, and from which byte on. Nothing behind the first
    damaged byte counts.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.topics: dict[str, Topic] = {}
        self.provenance: dict[str, str] = {}
        self.digests: dict[str, str] = {}
        self.end: dict[str, str] | None = None
        self.warnings: list[str] = []
        self._sound = True
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._blocks: list[tuple[int, frozenset[int]]] = []  # offset, channels with messages

    @classmethod
    def open(cls, path: str | Path) -> Recording:
        """Scan a file. Raises RecordingError where it is not there, not readable or not MCAP."""
        recording = cls(path)
        try:
            recording._scan()
        except OSError as error:
            raise RecordingError(
                f"{path}: {error.strerror}: give an MCAP file that can be read"
            ) from None
        return recording

    def _scan(self) -> None:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            if size == 0:
                raise RecordingError(f"{self.path} is empty: nothing was recorded; record it again")
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{self.path} is not an MCAP file: give a recording of a run")
            try:
                for record in records(file, size):
                    self._take(record)
            except ChecksumError as error:
                self._sound = False
                self.warnings.append(str(error))
            except DamageError as error:
                self.warnings.append(str(error))
        if self.end is None:
            self.warnings.append(f"no {END} record: the recorder was not ended in order")
        elif self.end.get("complete") != "true":
            self.warnings.append(f"incomplete: {self.end.get('reason', 'no reason given')}")

    def _take(self, record: Record) -> None:
        if record.opcode in _BLOCKS:
            self._take_block(content_of(record), record.offset)
            return
        try:
            self._take_record(record)
        except Exception as error:  # whatever a damaged record makes of its reader
            raise damaged(record, error) from None

    def _take_record(self, record: Record) -> None:
        if record.opcode == Opcode.SCHEMA:
            schema = Schema.read(record.stream)
            self._schemas.setdefault(schema.id, schema)
        elif record.opcode == Opcode.CHANNEL:
            channel = Channel.read(record.stream)
            if self._channels.setdefault(channel.id, channel) is channel:
                described = self._schemas.get(channel.schema_id)
                self.topics.setdefault(channel.topic, Topic(described.name if described else ""))
        elif record.opcode == Opcode.METADATA:
            metadata = Metadata.read(record.stream)
            if metadata.name == PROVENANCE:
                self.provenance.update(metadata.metadata)
            elif metadata.name == DIGESTS:
                self.digests = metadata.metadata
            elif metadata.name == END:
                self.end = metadata.metadata

    def _take_block(self, content: Content, offset: int) -> None:
        for record in content.records:
            self._take(record)
        if not content.spans.keys() <= self._channels.keys():
            raise DamageError(f"the record at byte {offset} has messages of an unknown channel")
        for channel, spans in content.spans.items():
            topic = self.topics[self._channels[channel].topic]
            topic.count += len(spans)
            topic.size += sum(span.end - span.start for span in spans)
            first, last = (
                _stamp(content.data[span.start : span.start + 12])
                if topic.type in _STAMPED
                else span.log_time_ns
                for span in (spans[0], spans[-1])
            )
            if topic.first_stamp_ns is None:
                topic.first_stamp_ns = first
            topic.last_stamp_ns = last
        self._blocks.append((offset, frozenset(content.spans)))

    @property
    def complete(self) -> bool:
        """True where the recorder says that the whole run is in the file, and nothing was altered."""
        return self._sound and self.end is not None and self.end.get("complete") == "true"

    def altered_topics(self) -> list[str]:
        """Return the topics whose messages are not those that the recorder wrote, by its digests."""
        altered = []
        for topic, digest in sorted(self.digests.items()):
            found = hashlib.blake2b(digest_size=16)
            for _, messages in self.messages(topic):
                for data in messages:
                    found.update(data)
            if found.hexdigest() != digest:
                altered.append(topic)
        return altered

    @property
    def namespace(self) -> str:
        """The namespace of the run, as ``/robot``; empty for the root."""
        suffix = f"/{names.GROUND_TRUTH}"
        return next((t.removesuffix(suffix) for t in self.topics if t.endswith(suffix)), "")

    def topic(self, relative: str) -> str:
        """Return the absolute name of a relative topic or node."""
        return f"{self.namespace}/{relative}"

    @property
    def controller(self) -> str | None:
        """The node whose ``~/state`` was recorded; of several the one with most messages."""
        prefix, suffix = self.topic(""), "/state"
        counts = {
            name.removeprefix(prefix).removesuffix(suffix): topic.count
            for name, topic in self.topics.items()
            if topic.count and name.startswith(prefix) and name.endswith(suffix)
        }
        return max(counts, key=lambda name: counts[name], default=None)

    def messages(self, topic: str) -> Iterator[tuple[list[int], list[bytes]]]:
        """Yield ``(log times in ns, messages)`` of a topic, block by block, in the file's order."""
        wanted = {number for number, channel in self._channels.items() if channel.topic == topic}
        with self.path.open("rb") as file:
            for offset, channels in self._blocks:
                if wanted.isdisjoint(channels):
                    continue
                content = content_of(read_record(file, offset))
                spans = [s for channel in wanted for s in content.spans.get(channel, ())]
                if len(wanted) > 1:
                    spans.sort(key=lambda span: span.start)
                yield (
                    [span.log_time_ns for span in spans],
                    [content.data[span.start : span.end] for span in spans],
                )

    def joints(self, topic: str) -> JointArrays:
        """Return all messages of a JointState topic (absolute name), none for an unknown topic.

        Raises RecordingError where they are not JointState messages.
        """
        try:
            return concatenate([decode(data, log) for log, data in self.messages(topic)])
        except (ValueError, OverflowError) as error:
            raise RecordingError(
                f"{self.path}: {topic} cannot be read as JointState: {error}"
            ) from None

    def _parsed(self, relative: str, parse: Callable[[bytes], Parsed]) -> list[Parsed]:
        topic = self.topic(relative)
        try:
            return [parse(data) for _, messages in self.messages(topic) for data in messages]
        except ValueError as error:
            raise RecordingError(f"{self.path}: {topic} cannot be read: {error}") from None

    def _parameter_events(self) -> list[ParameterChange]:
        return self._parsed(names.RUN_PARAMETERS, parse_parameter_event)

    def parameters(self) -> dict[str, dict[str, Value]]:
        """Return every node's first full set of parameters, by its fully qualified name."""
        found: dict[str, dict[str, Value]] = {}
        for event in self._parameter_events():
            if event.new:
                found.setdefault(event.node, event.new)
        return found

    def parameter_changes(self) -> list[ParameterChange]:
        """Return what changed in the run; each change applies to states with a greater stamp."""
        return [event for event in self._parameter_events() if event.changed]

    def events(self) -> list[RunEvent]:
        """Return the events of the run in the file's order."""
        return self._parsed(names.RUN_EVENTS, parse_event)


def _stamp(data: bytes) -> int:
    order: Literal["little", "big"] = "little" if data[1:2] == b"\x01" else "big"
    sec = int.from_bytes(data[4:8], order, signed=True)
    return sec * NANOSECONDS + int.from_bytes(data[8:12], order)
