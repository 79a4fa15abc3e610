"""Makes a valid, indexed file from a broken one, with everything readable, and reports what was lost."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import Writer

from .. import topics
from ..errors import RecordingError
from ..files import atomic_write
from ..units import NANOSECONDS
from .content import Content
from .digests import DIGESTS, END
from .joint_table import pieces
from .limits import Budget, LimitError
from .mcap_file import (
    ChecksumError,
    DamageError,
    LimitReachedError,
    Record,
    TrailingError,
    check_magic,
    check_schema_limits,
    is_known,
    name_of,
    numbered,
    records,
    size_of,
    visit,
)
from .messages import Messages
from .schemas import parse_event, parse_parameter_event
from .summary import Summary, read_summary
from .topic import STAMP_SIZE, STAMPED, fields_of

LIBRARY = "trunk_msgs_util recover"
LAST_TIME_NS = 2**63 - 1  # the year 2262
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
    if nothing can be read, FileExistsError, and OSError. Beyond a limit (`limits`) nothing is read.
    """
    recovery = Recovery()
    size = size_of(path)
    with path.open("rb") as file:
        check_magic(path, file, size)
        if output.exists() and output.samefile(path):
            raise FileExistsError(f"{output} is the broken file itself: choose another name")
        with atomic_write(output, overwrite=overwrite) as part:
            with part.open("wb") as target:
                _Copy(file, size, target, recovery).run()
            if not recovery.count:
                raise RecordingError(f"{path}: no message can be read: nothing was recovered")
    return recovery


class _Copy:
    """Schemas and channels keep their content and get new numbers."""

    def __init__(self, file: BinaryIO, size: int, target: BinaryIO, recovery: Recovery) -> None:
        self._file, self._size, self._recovery = file, size, recovery
        self._writer = Writer(target, enable_data_crcs=True)
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, tuple[int, str, str]] = {}  # new number, topic, type
        self._types: dict[int, str] = {0: ""}
        self._end: dict[str, str] | None = None
        self._seen = 8  # everything before this byte was read or given up
        self._budget = Budget(size)
        self._unread = True  # the summary

    def run(self) -> None:
        self._writer.start("ros2", LIBRARY)
        start = 8
        while start < self._size:
            start = self._stretch(start)
        self._writer.flush()
        end = self._end or {}
        lost = "; ".join(self._recovery.lost[:_LOSSES]) or "nothing"
        if len(self._recovery.lost) > _LOSSES:
            lost += f"; and {len(self._recovery.lost) - _LOSSES} more losses"
        before = "complete" if end.get("complete") == "true" else end.get("reason", "no end")
        reason = f"recovered; it was: {before}; lost: {lost}"
        self._writer.add_metadata(END, {"complete": "false", "recovered": "true", "reason": reason})
        self._writer.finish()

    def _lose(self, error: DamageError) -> None:
        """Note a loss; at the first, read schemas and channels from the summary: they may be lost too."""
        self._recovery.lost.append(str(error))
        summary, self._unread = self._unread and self._summary, False
        if summary and summary.footer.summary_crc == summary.crc:
            try:
                for schema in summary.schemas:
                    self._describe(schema)
                for channel in summary.channels:
                    self._describe(channel)
            except LimitError as error:
                self._recovery.lost.append(f"the summary describes {error}")

    @cached_property
    def _summary(self) -> Summary | None:
        try:
            return read_summary(self._file, self._size)
        except ValueError:
            return None

    @cached_property
    def _chunks(self) -> list[int]:
        """Where chunks begin, according to the index."""
        return sorted(c.chunk_start_offset for c in self._summary.chunks) if self._summary else []

    def _describe(self, item: Schema | Channel) -> None:
        if isinstance(item, Schema):
            if item.id not in self._schemas:
                check_schema_limits(len(self._schemas) - 1, item)
                number = self._writer.register_schema(item.name, item.encoding, item.data)
                self._schemas[item.id], self._types[item.id] = number, item.name
        elif item.id not in self._channels:
            check_schema_limits(len(self._channels), item)
            schema = self._schemas.get(item.schema_id, 0)
            number = self._writer.register_channel(
                item.topic, item.message_encoding, schema, item.metadata
            )
            kind = self._types.get(item.schema_id, "")
            self._channels[item.id] = (number, item.topic, kind)

    def _stretch(self, start: int) -> int:
        """Copy from a byte on; return where to resume after damage, or the file's size."""
        self._file.seek(start)
        try:
            for record in records(self._file, self._size, start):
                at = self._file.tell()
                try:
                    content = visit(record, self._budget, self._take_other)
                    if content is not None:
                        self._messages(content, record)
                except LimitReachedError:
                    raise
                except DamageError as error:
                    self._lose(error)
                self._file.seek(at)
                self._seen = record.end
        except ChecksumError as error:
            self._recovery.lost.append(f"{error}, but its records can be read")
        except LimitReachedError as error:
            self._recovery.lost.append(f"{error}; nothing after it is read")
        except TrailingError as error:
            self._recovery.lost.append(str(error))
        except DamageError as error:
            self._lose(error)
            return self._next_chunk()
        return self._size

    def _next_chunk(self) -> int:
        """Return the start of the next chunk after the damage, by the index."""
        after = bisect_right(self._chunks, self._seen)
        following = self._chunks[after] if after < len(self._chunks) else self._size
        self._seen = following
        return following

    def _take_other(self, record: Record) -> None:
        if record.opcode == Opcode.SCHEMA:
            if numbered(record) not in self._schemas:
                self._describe(Schema.read(record.stream))
        elif record.opcode == Opcode.CHANNEL:
            if numbered(record) not in self._channels:
                self._describe(Channel.read(record.stream))
        elif record.opcode == Opcode.METADATA:
            metadata = Metadata.read(record.stream)
            if metadata.name == END:
                self._end = metadata.metadata
            elif metadata.name != DIGESTS:
                self._writer.flush()
                self._writer.add_metadata(metadata.name, metadata.metadata)
            elif not self._recovery.lost:
                # Digests cover the whole run: after a loss they would flag what is left as altered.
                # The rest is not what it was: numbers of channels, the end record.
                topics = {k: v for k, v in metadata.metadata.items() if k.startswith("/")}
                self._writer.flush()
                self._writer.add_metadata(DIGESTS, topics)
        elif record.opcode == Opcode.ATTACHMENT or not is_known(record.opcode):
            place = f"the {name_of(record.opcode)} record at byte {record.offset}"
            self._recovery.lost.append(f"{place}: only messages and metadata are copied")

    def _messages(self, content: Content, record: Record) -> None:
        messages = content.messages(content.channels)
        if messages is None:
            return
        unknown = content.channels.keys() - self._channels.keys()
        if unknown:
            raise DamageError(
                f"the record at byte {record.offset} has messages of an unknown channel"
            )
        for row, data in enumerate(messages.bytes()):
            head = messages.head(row)
            number, topic, kind = self._channels[head.channel]
            log_time_ns = head.log_time_ns
            if log_time_ns > LAST_TIME_NS and kind in STAMPED and len(data) >= STAMP_SIZE:
                sec, nanosec = fields_of(messages.only(row))
                log_time_ns = max(int(sec[0]) * NANOSECONDS + int(nanosec[0]), 0)
            fault = "its log time is beyond the year 2262" if log_time_ns > LAST_TIME_NS else ""
            if fault := fault or _fault(kind, topic, messages.only(row)):
                self._recovery.lost.append(
                    f"a message on {topic} in the record at byte {record.offset}: {fault}"
                )
                continue
            self._writer.add_message(number, log_time_ns, data, head.publish_time_ns, head.sequence)
            self._recovery.messages[topic] = self._recovery.messages.get(topic, 0) + 1


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
