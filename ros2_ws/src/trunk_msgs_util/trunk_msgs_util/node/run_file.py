"""The file that the recorder writes: its name, topics and pictures, and a disk that may fail at any time."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path

from .. import topics
from ..parameters.config import RecorderConfig
from ..parameters.declarations import ParameterError
from ..picture.film import Film, value
from ..recording.schemas import ParameterChange
from ..recording.writer import PROVENANCE, RecordingWriter
from ..topics import JOINT_STATE_TYPE
from .conversions import WireReader

_SUFFIX = ".mcap"


class RunFile:
    """Takes messages by relative topic name; the first disk failure is reported, and no call raises."""

    def __init__(
        self,
        writer: RecordingWriter,
        full_name: Callable[[str], str],
        failed: Callable[[str], None],
        syncs: bool = False,
    ) -> None:
        """``full_name`` returns a topic's full name; ``failed`` is told why the recording ends here.

        ``syncs``: `sync` is called now and then, and at its end the file is on the disk.
        """
        self._writer = writer
        self._full_name = full_name
        self._failed = failed
        self._channels: dict[str, int] = {}
        self._syncs = syncs
        self._beside = ThreadPoolExecutor(1, "sync")
        self._sync: Future[None] | None = None

    @property
    def path(self) -> Path:
        return self._writer.path

    def begin(self, provenance: dict[str, str], types: Mapping[str, str]) -> None:
        """Write where the run comes from, and which topics there are, with their types."""
        try:
            self._writer.add_metadata(PROVENANCE, provenance)
        except OSError as error:
            self._fail(error)
        for topic, type_name in types.items():
            self._channels[topic] = self._writer.channel(self._full_name(topic), type_name)
        self.flush()

    def write(self, topic: str, log_ns: int, data: bytes) -> bool:
        """Write a message; return False if the disk failed. A topic not met before holds joint states."""
        try:
            if topic not in self._channels:
                name = self._full_name(topic)
                self._channels[topic] = self._writer.channel(name, JOINT_STATE_TYPE)
            self._writer.write(self._channels[topic], log_ns, log_ns, data)
        except OSError as error:
            self._fail(error)
            return False
        return True

    def flush(self) -> None:
        """Hand what was written over to the system."""
        try:
            self._writer.flush()
        except OSError as error:
            self._fail(error)

    def sync(self) -> None:
        """Have the disk take what was flushed, while the loop goes on."""
        if self._sync is None or self._sync.done():
            self._sync = self._beside.submit(self._writer.sync)

    def check(self) -> None:
        """Detect early that the file was deleted, renamed, replaced or truncated, or is not on the disk."""
        try:
            self._writer.check()
            if self._sync is not None and self._sync.done():
                self._sync.result()
        except OSError as error:
            self._fail(error)

    def finish(self, complete: bool, reason: str) -> int | None:
        """Write how the run ended; return how many messages there are, None if the disk failed."""
        self._beside.shutdown()  # the file stays open for it
        try:
            self._writer.finish(complete=complete, reason=reason, sync=self._syncs)
        except OSError as error:
            self._fail(error)
            return None
        return sum(topic.messages for topic in self._writer.summary().topics)

    def _fail(self, error: OSError) -> None:
        self._failed(f"{self.path}: cannot write: {error.strerror}; the recording ends here")


def open_output(config: RecorderConfig) -> RecordingWriter:
    """Create the file. Raises ParameterError if it cannot be written or already exists."""
    path = Path(config.output or time.strftime(f"trunk_%Y%m%dT%H%M%SZ{_SUFFIX}", time.gmtime()))
    if path.suffix.lower() != _SUFFIX and not path.is_relative_to("/dev"):
        raise _refused(path, f"the file's name must end in {_SUFFIX}, such as {path / 'run.mcap'}")
    try:
        return RecordingWriter(path, compression=config.compression, overwrite=config.overwrite)
    except FileExistsError:
        way_out = "it exists: give another name, or -p overwrite:=true to replace it"
        raise _refused(path, way_out) from None
    except OSError as error:
        raise _refused(path, f"a file to write ({error})") from None


def _refused(path: Path, allowed: str) -> ParameterError:
    return ParameterError("output", str(path), allowed)


_TERMS = "terms"  # those of the controller heard last
_OF_A_PLANT = "plant.length"  # a parameter that no other node has


class Pictures:
    """What a recorder hears, as the pictures that it records for 3-D views.

    Keeps the newest message of what a picture shows, as bytes; only what is drawn is parsed.
    """

    def __init__(self) -> None:
        self._film = Film()
        self._newest: dict[str, bytes] = {}
        self._read: defaultdict[str, WireReader] = defaultdict(WireReader)

    def taking(self, topic: str) -> Callable[[bytes], None] | None:
        """Return the function that takes a topic's messages; None for a topic that no picture shows."""
        if topic == topics.DISTURBANCE:
            return partial(self._newest.__setitem__, topic)
        if topics.is_controller_state(topic):
            return partial(self._newest.__setitem__, _TERMS)
        return None

    def reconfigure(self, change: ParameterChange) -> None:
        """Take a node's parameters."""
        for values in (change.new, change.changed):
            if _OF_A_PLANT in values:
                self._film.reconfigure(values)

    def picture(self, stamp_ns: int, truth: bytes, log_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield the topics and messages of a true state's picture; none for a state that is not drawn."""
        if not self._film.is_due(stamp_ns):
            return
        read = {name: self._read[name](data) for name, data in self._newest.items()}
        state = self._read[topics.GROUND_TRUTH](truth)
        reference = value(read.get(_TERMS), "position", "reference")
        yield from self._film.picture(state, read.get(topics.DISTURBANCE), reference, log_ns)
