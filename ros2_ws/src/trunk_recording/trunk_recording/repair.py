"""Makes a valid, indexed file from a broken one, with everything readable, and reports what was lost."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Schema
from mcap.writer import Writer

from trunk_core import topics
from trunk_core.errors import RecordingError
from trunk_core.files import atomic_write

from .digests import DIGESTS, END, uncoverable
from .joint_table import pieces
from .mcap_file import (
    DamageError,
    McapFile,
    Record,
    TrailingError,
    check_magic,
    name_of,
    records,
    size_of,
)
from .messages import MAGIC, Messages
from .schemas import parse_event, parse_parameter_event
from .summary import Summary, read_summary

LIBRARY = "trunk_msgs_util recover"
_LOSSES = 20  # listed in the end record


@dataclass
class Recovery:
    """What was saved and what was lost."""

    messages: dict[str, int] = field(default_factory=dict)  # by topic
    lost: list[str] = field(default_factory=list)  # a line each

    @property
    def count(self) -> int:
        """All messages that were saved."""
        return sum(self.messages.values())


def recover(path: Path, output: Path, overwrite: bool = False) -> Recovery:
    """Write everything readable in an MCAP file as a finished one, and return the outcome.

    Messages that cannot be read are left out; one whose log time is beyond the year 2262 gets its stamp's.

    Damaged chunks are left out; after damage that hides where the next record begins, the file's
    own index says where to go on. The end record says "complete: false" and why. Raises RecordingError
    if nothing can be read, FileExistsError, and OSError.
    """
    recovery = Recovery()
    size = size_of(path)
    with path.open("rb") as file:
        check_magic(path, file, size)
        if output.exists() and output.samefile(path):
            raise FileExistsError(f"{output} is the broken file itself: choose another name")
        with atomic_write(output, overwrite=overwrite) as part:
            with part.open("wb") as target:
                _Copy(McapFile(path, {}), target, recovery).run(file, size)
            if not recovery.count:
                raise RecordingError(f"{path}: no message can be read: nothing was recovered")
    return recovery


class _Copy:
    """Schemas and channels keep their content and get new numbers."""

    def __init__(self, file: McapFile, target: BinaryIO, recovery: Recovery) -> None:
        self._file, self._recovery = file, recovery
        self._writer = Writer(target, enable_data_crcs=True)
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}

    def run(self, stream: BinaryIO, size: int) -> None:
        file, lost = self._file, self._recovery.lost
        summary: Summary | None = None
        with suppress(ValueError):
            summary = read_summary(stream, size)
        self._writer.start("ros2", LIBRARY)
        chunks = sorted(chunk.chunk_start_offset for chunk in summary.chunks) if summary else []
        for record in _salvaged(stream, size, chunks, lost):
            if lost and summary and summary.footer.summary_crc == summary.crc:
                described: list[Schema | Channel] = [*summary.schemas, *summary.channels]
                for item in described:  # the data's may be lost, too
                    file.take_described(item)
                summary = None
            try:
                content = file.take(record)
            except DamageError as error:
                lost.append(str(error))
                continue
            if content and (messages := content.messages(content.channels)):
                self._messages(messages, record)
        for channel in file.channels:
            self._channel(channel)
        others = uncoverable((), file.attachments, map(name_of, file.unknown))
        lost += [f"{part}: only messages and metadata are copied" for part in others]
        self._end(file.metadata_records)

    def _end(self, metadata: list[tuple[str, dict[str, str]]]) -> None:
        """Write the metadata and the end record."""
        lost, before = self._recovery.lost, "no end"
        self._writer.flush()
        for name, values in metadata:
            if name == END:
                complete = values.get("complete") == "true"
                before = "complete" if complete else values.get("reason", before)
            elif name != DIGESTS:
                self._writer.add_metadata(name, values)
            elif not lost:
                # Digests cover the whole run: after a loss they would flag what is left as altered.
                # The rest is not what it was: numbers of channels, the end record.
                of_topics = {k: v for k, v in values.items() if k.startswith("/")}
                self._writer.add_metadata(DIGESTS, of_topics)
        losses = "; ".join(lost[:_LOSSES]) or "nothing"
        if len(lost) > _LOSSES:
            losses += f"; and {len(lost) - _LOSSES} more losses"
        reason = f"recovered; it was: {before}; lost: {losses}"
        self._writer.add_metadata(END, {"complete": "false", "recovered": "true", "reason": reason})
        self._writer.finish()

    def _channel(self, number: int) -> int:
        """Return a channel's new number."""
        if number not in self._channels:
            channel = self._file.channels[number]
            schema = self._file.schemas.get(channel.schema_id)
            if schema and schema.id not in self._schemas:
                self._schemas[schema.id] = self._writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            self._channels[number] = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                self._schemas[schema.id] if schema else 0,
                channel.metadata,
            )
        return self._channels[number]

    def _messages(self, messages: Messages, record: Record) -> None:
        for row, data in enumerate(messages.bytes()):
            head, message = messages.head(row), messages.only(row)
            topic, kind = self._file.channels[head.channel].topic, self._file.type_of(head.channel)
            log_time_ns = int(message.log_time_ns[0])
            if log_time_ns < 0:  # beyond the year 2262
                log_time_ns = int(self._file.stamps(message)[0])
            fault = "its log time is beyond the year 2262" if log_time_ns < 0 else ""
            if fault := fault or _fault(kind, topic, message):
                self._recovery.lost.append(
                    f"a message on {topic} in the record at byte {record.offset}: {fault}"
                )
                continue
            number = self._channel(head.channel)
            self._writer.add_message(number, log_time_ns, data, head.publish_time_ns, head.sequence)
            self._recovery.messages[topic] = self._recovery.messages.get(topic, 0) + 1


def _salvaged(stream: BinaryIO, size: int, chunks: list[int], lost: list[str]) -> Iterator[Record]:
    """Yield the records that are whole; where damage hides the next one, go on at the next chunk."""
    seen = len(MAGIC)
    while seen < size:
        stream.seek(seen)
        try:
            for record in records(stream, size, seen):
                yield record
                seen = record.end
            return
        except DamageError as error:
            lost.append(str(error))
            if isinstance(error, TrailingError):  # what follows is no part of the file
                return
        after = bisect_right(chunks, seen)
        seen = chunks[after] if after < len(chunks) else size


def _fault(kind: str, topic: str, message: Messages) -> str:
    """Return why a message cannot be read; empty if it can, or is of a type that is not read."""
    try:
        if kind == topics.JOINT_STATE_TYPE:
            pieces(message)
        elif topic.endswith(f"/{topics.RUN_EVENTS}"):
            parse_event(*message.bytes())
        elif topic.endswith(f"/{topics.RUN_PARAMETERS}"):
            parse_parameter_event(*message.bytes())
    except ValueError as error:
        return str(error)
    return ""
