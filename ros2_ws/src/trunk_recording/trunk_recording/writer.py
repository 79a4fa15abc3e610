"""`RecordingWriter`: writes one run into one MCAP file, as ROS 2's tools would.

The file is locked against a second writer, and still the one that its path names.

The library takes ten microseconds for a message, most of what recording costs. Here a message is packed
once, or many of several topics in bulk; checksums and index are made chunk by chunk. All other records are
the library's own.

What rosbag2 keeps beside the messages is there too, so that its tools take a recording for one of their own.
Each channel's metadata has the quality of service that its publishers offered and its type's hash. From
these, `ros2 bag play` creates publishers that offer late subscriptions the past where the recorded ones
did. A metadata record, and ``metadata.yaml`` in a folder, sum up the bag. Version 9 of both, as Jazzy writes
them (rosbag2_storage/yaml.hpp and qos.cpp, rosbag2_storage_mcap/mcap_storage.cpp).
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from stat import S_ISREG
from threading import Thread
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import LIBRARY_IDENTIFIER
from numpy.typing import NDArray
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9

from trunk_core import topics
from trunk_core.yaml_text import dump, load

from .digests import DIGESTS, END, PROVENANCE, RunningDigests
from .messages import HEAD, HEAD_FIELDS, MAGIC, MESSAGE_HEAD, unaligned
from .schemas import definition, type_hash

if TYPE_CHECKING:
    from types import TracebackType

    from trunk_core.arrays import Integers

__all__ = ["END", "PROVENANCE", "RecordingWriter"]


def open_own(path: Path, *, overwrite: bool) -> BinaryIO:
    """Create a file, or empty the one that is there, and lock it until it is closed.

    Raises FileExistsError where it exists, unless ``overwrite``, and BlockingIOError where another process is
    writing it: then it is left as it is. The lock ends with its process; a leftover file has none.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | (0 if overwrite else os.O_EXCL)
    try:
        number = os.open(path, flags, 0o666)
    except FileExistsError:
        raise FileExistsError(f"{path} exists: choose another name, or overwrite it") from None
    file = open(number, "wb")  # noqa: PTH123, SIM115  a descriptor; the caller closes it
    try:
        _lock(file, path)
        if S_ISREG(os.fstat(number).st_mode):
            file.truncate(0)
    except OSError:
        file.close()
        raise
    return file


def is_being_written(path: Path) -> bool:
    """Return True if a process holds the lock of a file. Raises OSError where it cannot be opened."""
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # this file system has no locks
            pass
    return False


def _lock(file: BinaryIO, path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BlockingIOError(
            f"{path} is being written by another process: choose another name, or stop that one"
        ) from None
    except OSError:  # this file system has no locks
        pass


def check_own(file: BinaryIO, path: Path) -> None:
    """Raise OSError where ``path`` no longer names this file, or another process has changed its size."""
    here = os.fstat(file.fileno())
    if not S_ISREG(here.st_mode):  # a terminal or a device
        return
    there = None
    with suppress(FileNotFoundError, NotADirectoryError):
        there = path.stat()
    if there is None:
        # Some file systems (NFS, an overlay by FUSE) still count a link to a file that is deleted.
        how = "renamed or deleted" if here.st_nlink else "deleted"
        raise FileNotFoundError(errno.ENOENT, f"it has been {how}")
    if (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino):
        raise OSError(errno.ESTALE, "another file has been put in its place")
    written = os.lseek(file.fileno(), 0, os.SEEK_CUR)  # what is still buffered does not count
    if here.st_size != written:
        how = "truncated" if here.st_size < written else "written to by another process"
        raise OSError(errno.ESTALE, f"it has been {how}")


RECORD = "rosbag2"  # name of the metadata record
_SERIALIZED = "serialized_metadata"
_VERSION = 9
_INFINITE = QosTime(9223372036, 854775807)


class TopicCount(NamedTuple):
    """A topic in a bag's summary."""

    name: str
    type: str
    messages: int


class BagSummary(NamedTuple):
    """What a bag holds: its topics in the order of their channels, and its log times, ns."""

    topics: tuple[TopicCount, ...]
    first_ns: int
    last_ns: int


def channel_metadata(topic: str, type_name: str) -> dict[str, str]:
    """Return a channel's metadata. Raises ValueError for an unknown type."""
    return {
        "offered_qos_profiles": _text(_qos(_is_latched(topic))),
        "topic_type_hash": type_hash(type_name),
    }


def summary_record(summary: BagSummary) -> dict[str, str]:
    """Return the values of the metadata record; it names no file, since a file may be renamed."""
    return {_SERIALIZED: _text(_information(summary))}


def metadata_yaml(record: Mapping[str, str], file: str) -> str:
    """Return the text of ``metadata.yaml`` for a folder with one file, from that file's own record.

    Raises ValueError for a record that is not one of ours.
    """
    about = load(record.get(_SERIALIZED, ""))
    try:
        summed_up = {name: about[name] for name in ("starting_time", "duration", "message_count")}
    except (TypeError, KeyError) as error:
        raise ValueError(f"no summary of a bag: {error}") from None
    about |= {"relative_file_paths": [file], "files": [{"path": file, **summed_up}]}
    return _text({"rosbag2_bagfile_information": about}) + "\n"


def _information(summary: BagSummary) -> dict[str, Any]:
    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": summary.last_ns - summary.first_ns},
        "starting_time": {"nanoseconds_since_epoch": summary.first_ns},
        "message_count": sum(topic.messages for topic in summary.topics),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": _qos(_is_latched(topic.name)),
                    "type_description_hash": type_hash(topic.type),
                },
                "message_count": topic.messages,
            }
            for topic in summary.topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [],
        "files": [],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _is_latched(topic: str) -> bool:
    return any(topic.endswith(f"/{name}") for name in topics.LATCHED)


@cache
def _profile(latched: bool) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        topics.LATCHED_DEPTH if latched else topics.LIVE_DEPTH,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        _INFINITE,
        _INFINITE,
        QosLiveliness.AUTOMATIC,
        _INFINITE,
        False,
    )


def _qos(latched: bool) -> list[Any]:
    return list(dump_qos_v9([_profile(latched)]))


def _text(value: object) -> str:
    return dump(value, default_flow_style=False).rstrip("\n")


class Rows(NamedTuple):
    """N messages of one channel that are equally long, in their order."""

    channel: int
    place: Integers  # [N], ascending: where among the messages of all channels
    time_ns: Integers  # [N], log and publish time, not negative
    data: NDArray[Any]  # [N], one element is one message


class Interleaved(NamedTuple):
    """M message records, one after the other; record i is ``data[start[i]:end[i]]``."""

    data: NDArray[np.uint8]
    start: Integers
    end: Integers
    channel: Integers
    time_ns: Integers

    def records(self, first: int, last: int) -> bytes:
        """Return the records in [first, last)."""
        return self.data[self.start[first] : self.end[last - 1]].tobytes()

    def heads(self, first: int, last: int) -> bytes:
        """Return the header of each message's data in the records in [first, last)."""
        return self._pieces(self.start[first:last], HEAD_FIELDS.itemsize)

    def messages(self, rows: Integers) -> bytes:
        """Return the messages of some records without their heads."""
        start, end = self.start[rows] + HEAD_FIELDS.itemsize, self.end[rows]
        size = int(end[0] - start[0])
        if (end - start == size).all():
            return self._pieces(start, size)
        spans = zip(start.tolist(), end.tolist(), strict=True)
        return b"".join([self.data[a:b].tobytes() for a, b in spans])

    def _pieces(self, start: Integers, size: int) -> bytes:
        return unaligned(self.data, f"V{size}")[start].tobytes()


def interleaved(rows: Sequence[Rows], counts: dict[int, int]) -> Interleaved:
    """Return the records of all rows by their place; of equal places the first in ``rows`` comes first.

    ``counts`` are the channels' next sequence numbers, and go on. Rows of the same channel follow
    one another.
    """
    rows = sorted(rows, key=lambda part: int(part.place[0]))  # as new channels enter ``counts``
    lengths = [len(part.place) for part in rows]
    sizes = np.repeat([HEAD_FIELDS.itemsize + part.data.itemsize for part in rows], lengths)
    order = np.argsort(np.concatenate([part.place for part in rows]), kind="stable")
    end = np.cumsum(sizes[order])
    start = end - sizes[order]
    data = np.empty(int(end[-1]), np.uint8)
    at = np.empty_like(start)
    at[order] = start
    first = 0
    for part, length in zip(rows, lengths, strict=True):
        records = _records(part, counts.get(part.channel, 0))
        counts[part.channel] = counts.get(part.channel, 0) + length
        unaligned(data, records.dtype)[at[first : first + length]] = records
        first += length
    channel = np.repeat([part.channel for part in rows], lengths)
    time_ns = np.concatenate([part.time_ns for part in rows])
    return Interleaved(data, start, end, channel[order], time_ns[order])


def _records(rows: Rows, sequence: int) -> NDArray[np.void]:
    size = rows.data.itemsize
    records = np.empty(len(rows.place), [("head", HEAD_FIELDS), ("data", f"V{size}")])
    head = records["head"]
    head["opcode"] = Opcode.MESSAGE
    head["length"] = HEAD_FIELDS.itemsize - HEAD.size + size
    head["channel"] = rows.channel
    head["sequence"] = np.arange(sequence, sequence + len(records))
    head["log_time"] = head["publish_time"] = rows.time_ns
    records["data"] = rows.data.view(f"V{size}")
    return records.view(f"V{records.itemsize}")


PROFILE, _LIBRARY = "ros2", f"trunk_msgs_util {LIBRARY_IDENTIFIER}"
_COMPRESSIONS = {"zstd": "zstd", "lz4": "lz4", "none": ""}
CHUNK_SIZE = 1 << 20
COMPRESSIONS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "": bytes,
}
_ENTRY = struct.Struct("<QQ")  # of a message index: log time, offset in the chunk

# Takes a chunk's message heads, and its messages by channel.
Taken = Callable[[bytes, dict[int, bytes]], None]


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    made: bytes = builder.end()
    return made


class ChunkedWriter:
    """Writes header, chunks with their indexes, metadata, and a summary; all checksums are on.

    Byte for byte what ``mcap.writer.Writer`` makes of the same calls.
    """

    def __init__(self, stream: BinaryIO, compression: str, taken: Taken) -> None:
        """Write to ``stream``; ``compression`` is a key of `COMPRESSIONS`."""
        self._stream = stream
        self._compression = compression
        self._taken = taken
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}  # of messages, per channel
        self.first_ns: int | None = None  # log times, of the chunks that are written
        self.last_ns = 0
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._records: list[bytes] = []
        self._size = 0
        self._heads: list[bytes] = []
        self._messages: dict[int, list[bytes]] = {}
        self._index: dict[int, bytearray] = {}  # entries per channel
        self._start_ns: int | None = None
        self._end_ns = 0

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)

    def start(self, profile: str, library: str) -> None:
        """Write the file's header."""
        self._write(MAGIC + _record(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its number."""
        self._schemas.append(Schema(len(self._schemas) + 1, data, encoding, name))
        self._add(_record(self._schemas[-1]))
        return len(self._schemas)

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: dict[str, str]
    ) -> int:
        """Add a channel and return its number."""
        number = len(self._channels) + 1
        self._channels.append(Channel(number, topic, encoding, metadata, schema))
        self._add(_record(self._channels[-1]))
        return number

    def _add(self, record: bytes) -> None:
        self._records.append(record)
        self._size += len(record)
        if self._size > CHUNK_SIZE:
            self._finish_chunk()

    def add_message(
        self, channel: int, log_time_ns: int, data: bytes, publish_time_ns: int
    ) -> None:
        """Add a message; sequence numbers count each channel's from 0."""
        sequence = self.counts.get(channel, 0)
        length = MESSAGE_HEAD.size - HEAD.size + len(data)
        head = MESSAGE_HEAD.pack(
            Opcode.MESSAGE, length, channel, sequence, log_time_ns, publish_time_ns
        )
        self.counts[channel] = sequence + 1
        if channel not in self._index:
            self._index[channel], self._messages[channel] = bytearray(), []
        self._index[channel] += _ENTRY.pack(log_time_ns, self._size)
        self._messages[channel].append(data)
        self._heads.append(head)
        self._records += (head, data)
        self._size += MESSAGE_HEAD.size + len(data)
        if self._start_ns is None or log_time_ns < self._start_ns:
            self._start_ns = log_time_ns
        if log_time_ns > self._end_ns:
            self._end_ns = log_time_ns
        if self._size > CHUNK_SIZE:
            self._finish_chunk()

    def add_rows(self, rows: Sequence[Rows]) -> None:
        """Add messages of several channels in the order of their place, as calls of `add_message` would."""
        rows = [part for part in rows if len(part.place)]
        if not rows:
            return
        many = interleaved(rows, self.counts)
        first, last = 0, len(many.end)
        while first < last:
            # Up to the record with which the chunk becomes too large, as in `add_message`.
            full = int(many.start[first]) + CHUNK_SIZE - self._size
            fits = int(np.searchsorted(many.end, full, side="right"))
            stop = min(max(fits, first) + 1, last)
            self._add_records(many, first, stop)
            if self._size > CHUNK_SIZE:
                self._finish_chunk()
            first = stop

    def _add_records(self, many: Interleaved, first: int, last: int) -> None:
        channels, times = many.channel[first:last], many.time_ns[first:last]
        offsets = many.start[first:last] - many.start[first] + self._size
        entries = np.stack([times, offsets], axis=1).astype("<u8")
        numbers, earliest = np.unique(channels, return_index=True)
        for number in numbers[np.argsort(earliest)].tolist():
            places = np.flatnonzero(channels == number)
            if number not in self._index:
                self._index[number], self._messages[number] = bytearray(), []
            self._index[number] += entries[places].tobytes()
            self._messages[number].append(many.messages(first + places))
        self._heads.append(many.heads(first, last))
        self._records.append(many.records(first, last))
        self._size += len(self._records[-1])
        least = int(times.min())
        self._start_ns = least if self._start_ns is None else min(least, self._start_ns)
        self._end_ns = max(int(times.max()), self._end_ns)

    def _finish_chunk(self) -> None:
        if self._start_ns is None:  # no message: other records wait for the next chunk
            return
        heads, start_ns, end_ns = b"".join(self._heads), self._start_ns, self._end_ns
        messages = {channel: b"".join(pieces) for channel, pieces in self._messages.items()}
        records, index = b"".join(self._records), self._index
        self._begin_chunk()
        self.first_ns = start_ns if self.first_ns is None else min(start_ns, self.first_ns)
        self.last_ns = max(end_ns, self.last_ns)
        self._taken(heads, messages)
        data = COMPRESSIONS[self._compression](records)
        chunk = _record(
            Chunk(self._compression, data, end_ns, start_ns, zlib.crc32(records), len(records))
        )
        at = self._stream.tell()
        offsets: dict[int, int] = {}
        indexes = b""
        for channel, entries in index.items():
            offsets[channel] = at + len(chunk) + len(indexes)
            head = (Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries))
            indexes += struct.pack("<BQHI", *head) + entries
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=at,
                compression=self._compression,
                compressed_size=len(data),
                message_end_time=end_ns,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=start_ns,
                uncompressed_size=len(records),
            )
        )
        self._write(chunk)
        self._write(indexes)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record, before the chunk that is being collected."""
        record = _record(Metadata(name, data))
        self._metadata.append(MetadataIndex(self._stream.tell(), len(record), name))
        self._write(record)

    def flush(self) -> None:
        """Write the chunk that is being collected, and hand everything to the operating system."""
        self._finish_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the end of the data, the summary and the footer."""
        self._finish_chunk()
        self._stream.write(_record(DataEnd(self._crc)))
        at = self._stream.tell()
        groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(_record, records))
            offsets += _record(SummaryOffset(opcode, at + len(summary), len(group)))
            summary += group
        offsets_at = at + len(summary)
        summary += offsets
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, at, offsets_at)
        self._stream.write(summary)
        self._stream.write(
            _record(Footer(at, offsets_at, zlib.crc32(footer_head, zlib.crc32(summary)))) + MAGIC
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self.counts,
            chunk_count=len(self._chunks),
            message_count=sum(self.counts.values()),
            message_end_time=self.last_ns,
            message_start_time=self.first_ns or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


class RecordingWriter:
    """Writes an MCAP file: profile ``ros2``, CDR, ``ros2msg`` schemas, chunks, all checksums on.

    As a context manager it finishes the file as complete, or, after an exception, as incomplete
    with the reason. After a failed write (a full disk) nothing more is written: the file ends
    there, without an end record, and is read as incomplete.
    """

    def __init__(
        self, path: str | Path, compression: str = "zstd", *, overwrite: bool = False
    ) -> None:
        """Create the file.

        Raises FileExistsError if it exists, unless ``overwrite``, and BlockingIOError if it is being written.
        """
        self.path = Path(path)
        self._file = open_own(self.path, overwrite=overwrite)
        self._named = False  # does the disk know of the file?
        self._writer = ChunkedWriter(self._file, _COMPRESSIONS[compression], self._digest)
        self._schemas: dict[str, int] = {}
        self._topics: dict[int, str] = {}
        self._types: dict[int, str] = {}
        self._digests = RunningDigests()
        self._failure: OSError | None = None
        self._syncing: Thread | None = None
        self._writer.start(PROFILE, _LIBRARY)
        self._digests.header(PROFILE, _LIBRARY)

    def channel(self, topic: str, type_name: str) -> int:
        """Add a topic, unless it is there, and return its channel. Raises ValueError for an unknown type."""
        for number, name in self._topics.items():
            if name == topic and self._types[number] == type_name:
                return number
        text = definition(type_name)
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text)
        schema = self._schemas[type_name]
        metadata = channel_metadata(topic, type_name)
        channel = self._writer.register_channel(topic, "cdr", schema, metadata)
        self._topics[channel] = topic
        self._types[channel] = type_name
        self._digests.channel(
            Channel(channel, topic, "cdr", metadata, schema),
            Schema(schema, text, "ros2msg", type_name),
        )
        return channel

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, cdr: bytes) -> None:
        """Write one message; both times in ns, not negative. Raises OSError if it fails."""
        self._check()
        try:
            self._writer.add_message(channel, log_time_ns, cdr, publish_time_ns)
        except OSError as error:
            raise self._failed(error) from None

    def write_rows(self, rows: Sequence[Rows]) -> None:
        """Write messages of several channels by their place. Raises OSError if it fails."""
        self._check()
        try:
            self._writer.add_rows(rows)
        except OSError as error:
            raise self._failed(error) from None

    def _digest(self, heads: bytes, messages: Mapping[int, bytes]) -> None:
        self._digests.heads(heads)
        for channel, joined in messages.items():
            self._digests.messages(self._topics[channel], joined)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a record of names and values, after all messages so far."""
        self.flush()
        try:
            self._writer.add_metadata(name, dict(data))
        except OSError as error:
            raise self._failed(error) from None
        self._digests.metadata(name, data)

    def flush(self) -> None:
        """Finish the chunk and hand everything to the operating system: SIGKILL then loses nothing.

        Raises OSError if it fails, also where `check` does.
        """
        self.check()  # before too: what is written now would fill up a file that was truncated
        try:
            self._writer.flush()
        except OSError as error:
            raise self._failed(error) from None
        self.check()

    def check(self) -> None:
        """Raise OSError if the file has been deleted, renamed, replaced or truncated.

        Nobody who opens its path could read what is written from then on.
        """
        self._check()
        try:
            check_own(self._file, self.path)
        except OSError as error:
            raise self._failed(error) from None

    def sync_beside(self) -> None:
        """Begin `sync` in another thread, unless it is under way; what follows raises its OSError."""

        def sync() -> None:
            with suppress(OSError):
                self.sync()

        if self._syncing is None or not self._syncing.is_alive():
            self._syncing = Thread(target=sync, name="sync")
            self._syncing.start()

    def sync(self) -> None:
        """Wait until the disk has what was flushed, and the file its name.

        Raises OSError if it fails, as does whatever follows: the system tells of a lost write once. A pipe or
        a device has no disk to wait for.
        """
        try:
            os.fdatasync(self._file.fileno())
            if not self._named:
                folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)
                self._named = True
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EROFS):
                raise self._failed(error) from None

    def finish(self, *, complete: bool, reason: str, sync: bool = False) -> None:
        """Write the end record, the digests and the index, and close the file; a second call does nothing.

        ``sync``: the disk then has it, too.
        Raises OSError, with the file closed, if a write has failed.
        """
        if self._file.closed:
            return
        if self._syncing is not None:
            self._syncing.join()  # the file stays open for it
        try:
            self.flush()
            self.add_metadata(RECORD, summary_record(self.summary()))
            self.add_metadata(END, {"complete": str(complete).lower(), "reason": reason})
            self.add_metadata(DIGESTS, self._digests.values())
            self._writer.finish()
            self._file.flush()
            self.check()
            if sync:
                self.sync()
            self._file.close()
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            raise self._failed(error) from None

    def summary(self) -> BagSummary:
        """Return the topics and messages of the last flush, in rosbag2's words."""
        counts = tuple(
            TopicCount(topic, self._types[channel], self._writer.counts.get(channel, 0))
            for channel, topic in self._topics.items()
        )
        return BagSummary(counts, self._writer.first_ns or 0, self._writer.last_ns)

    def _failed(self, error: OSError) -> OSError:
        """Return the first failure, naming the file; nothing is written after it."""
        if self._failure is None:
            self._failure = OSError(error.errno, error.strerror, str(self.path))
        return self._failure

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.finish(complete=True, reason="finished")
        else:
            text = " ".join(str(error).split())
            self.finish(complete=False, reason=f"{type(error).__name__}: {text}".removesuffix(": "))
