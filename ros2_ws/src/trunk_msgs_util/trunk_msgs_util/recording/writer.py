"""`RecordingWriter`: writes one run into one MCAP file, as ROS 2's tools would."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mcap.records import Channel, Schema
from mcap.writer import LIBRARY_IDENTIFIER

from . import rosbag2
from .digests import DIGESTS, END, PROVENANCE, RunningDigests
from .schemas import definition
from .writing.chunked import ChunkedWriter
from .writing.own_file import check_own, open_own

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

    from .writing.interleaved import Rows

__all__ = ["END", "PROVENANCE", "RecordingWriter"]

PROFILE, _LIBRARY = "ros2", f"trunk_msgs_util {LIBRARY_IDENTIFIER}"
_COMPRESSIONS = {"zstd": "zstd", "lz4": "lz4", "none": ""}


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
        metadata = rosbag2.channel_metadata(topic, type_name)
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

    def sync(self) -> None:
        """Wait until the disk has what was flushed, and the file its name; another thread may do so.

        Raises OSError if it fails. A pipe or a device has no disk to wait for.
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
                raise

    def finish(self, *, complete: bool, reason: str, sync: bool = False) -> None:
        """Write the end record, the digests and the index, and close the file; a second call does nothing.

        ``sync``: the disk then has it, too.
        Raises OSError, with the file closed, if a write has failed.
        """
        if self._file.closed:
            return
        try:
            self.flush()
            self.add_metadata(rosbag2.RECORD, rosbag2.summary_record(self.summary()))
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

    def summary(self) -> rosbag2.BagSummary:
        """Return the topics and messages of the last flush, in rosbag2's words."""
        counts = tuple(
            rosbag2.TopicCount(topic, self._types[channel], self._writer.counts.get(channel, 0))
            for channel, topic in self._topics.items()
        )
        return rosbag2.BagSummary(counts, self._writer.first_ns or 0, self._writer.last_ns)

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
