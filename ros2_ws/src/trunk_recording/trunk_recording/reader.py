"""`Recording`: the content of an MCAP file or rosbag2 folder, as far as it is sound."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from trunk_core import topics as names
from trunk_core.errors import RecordingError

from .bag_folder import METADATA, bag_folder
from .digests import DIGESTS, END, PROVENANCE, RunningDigests, differing, uncoverable, uncovered
from .joint_table import Column, Filling, JointTable, pieces
from .mcap_file import ERROR, OURS, McapFile, Topic, name_of, size_of
from .messages import LIMIT
from .schemas import ParameterChange, RunEvent, parse_event, parse_parameter_event
from .summary import open_by_summary, structure

if TYPE_CHECKING:
    from trunk_core.arrays import Floats

    from .digests import Content
    from .joint_table import Piece
    from .messages import Messages

__all__ = ["Ending", "Recording", "RecordingError", "Topic"]

Parsed = TypeVar("Parsed")
# Decompressed chunks kept for the next passes: a one-minute run is decompressed once.
_KEPT = 64 << 20
_TEXT = LIMIT // 8  # bytes of events, or of parameters: Python's objects take many times as many
# A larger file need not be read whole to be opened; smaller ones are scanned in no time.
_BY_SUMMARY = 32 << 20


class Ending(Enum):
    """How a recording ends."""

    COMPLETE = "its recorder marked it as complete"
    INCOMPLETE = "by its end record, or by what can be read"
    DAMAGED = "its end is there, something before it is damaged"
    CUT = "our recorder did not shut down properly"
    FOREIGN = "another program recorded it: nothing says whether it is complete"


class Recording:
    """The file, or a bag's files, of a recording: topics, metadata, messages as bytes and as tables.

    ``warnings`` lists what is missing or damaged, and from which byte on; ``unfinished`` is the one that
    says why no end record marks the run as complete, which may be damage. Nothing after the first damaged
    byte counts.
    """

    def __init__(self, path: str | Path, whole: bool = False, digests: bool = False) -> None:
        """``digests`` are made while the file is read; ``whole``: tables, too, for whoever judges it."""
        self.path = Path(path)
        self._digests = RunningDigests() if whole or digests else None
        self._whole = whole
        self._fillings: dict[str, Filling] = {}
        self.topics: dict[str, Topic] = {}
        self.provenance: dict[str, str] = {}
        self.digests: dict[str, str] = {}
        self.end: dict[str, str] | None = None
        self._warnings: list[str] = []
        self.ending = Ending.COMPLETE
        self.unfinished = ""
        self._damage = ""  # of a file whose end is there; among the warnings
        self.checked = True  # every record was read and is sound
        self.sound = True
        self._files: list[McapFile] = []
        self._kept: dict[tuple[int, int], Content] = {}
        self._kept_bytes = 0

    @classmethod
    def open(
        cls,
        path: str | Path,
        progress: Callable[[int, int], None] = lambda _done, _of: None,
        whole: bool = False,
        digests: bool = False,
    ) -> Recording:
        """Scan a file or a folder; ``progress`` is called with the bytes read and the total.

        ``digests``: make them in the same pass; ``whole``: tables too, for whoever judges all of it.
        Raises RecordingError if it is missing, not readable, or not MCAP.
        """
        return cls(path, whole, digests)._opened(progress)

    @classmethod
    def open_by_summary(
        cls, path: str | Path, progress: Callable[[int, int], None] = lambda _done, _of: None
    ) -> Recording:
        """Open a recording by its summary; ``checked`` is False if that was enough.

        Files of less than `_BY_SUMMARY` bytes, and those without a sound summary, are scanned.
        Raises as `open` does.
        """
        recording = cls(path)
        recording.checked = False
        return recording._opened(progress)

    def _opened(self, progress: Callable[[int, int], None]) -> Recording:
        with _reading(self.path):
            self._scan(progress)
        return self

    def _scan(self, progress: Callable[[int, int], None]) -> None:
        files, counted = [self.path], None
        is_bag = self.path.is_dir()
        if is_bag:
            files, counted = bag_folder(self.path)
        sizes = [size_of(path) for path in files]
        by_summary = not self.checked and sum(sizes) >= _BY_SUMMARY
        self.checked = True
        for i, path in enumerate(files):
            file = open_by_summary(path, self.topics) if by_summary else None
            if file is not None:
                self.checked = False
            else:
                file = McapFile(path, self.topics)
                report = partial(_report, progress, sum(sizes[:i]), sum(sizes))
                file.scan(
                    report,
                    partial(self._take_scanned, i, file),
                    self._fill if self._whole else None,
                )
            self._files.append(file)
            self.sound &= file.sound
            self.provenance.update(file.metadata[PROVENANCE])
            self.digests.update(file.metadata.get(DIGESTS, {}))
            self.end = file.metadata.get(END, self.end)
            if file.warning:
                self._warnings.append(f"{path.name}: {file.warning}" if is_bag else file.warning)
                self._damage = self._warnings[-1] if file.closed else ""
            if not file.whole:
                if path != files[-1]:
                    left = len(files) - i - 1
                    noun = "file is" if left == 1 else "files are"
                    self._warnings.append(f"{left} later {noun} not read")
                break
        self._judge(is_bag, counted)

    def _judge(self, is_bag: bool, counted: int | None) -> None:
        """Warn if nothing says that the run is whole."""
        count = sum(topic.count for topic in self.topics.values())
        if counted is not None and counted != count:
            self.sound = False
            self._warnings.append(f"{METADATA} counts {counted} messages, its files hold {count}")
        library = self._files[0].library
        marked = self.end is not None and self.end.get("complete") == "true"
        if marked and self._read_to_their_ends:
            return
        if self.end is not None and not marked:
            self.ending = Ending.INCOMPLETE
            self.unfinished = f"incomplete: {self.end.get('reason', 'no reason given')}"
        elif self._damage:
            self.ending, self.unfinished = Ending.DAMAGED, self._damage
            return
        elif marked:
            self.ending = Ending.INCOMPLETE
            self.unfinished = "incomplete: marked as complete, but not all of it can be read"
        elif library.startswith(OURS) or not (library or self._files[0].whole):
            self.ending = Ending.CUT
            self.unfinished = f"no {END} record: the recorder did not shut down properly"
        elif is_bag and counted is None:
            self.ending = Ending.CUT
            self.unfinished = f"no {METADATA}: the recorder did not shut down properly"
        else:
            self.ending = Ending.FOREIGN
            self.unfinished = (
                f"recorded by {library or 'a program that gives no name'}: "
                f"no {END} record says whether the run is complete"
            )
        self._warnings.append(self.unfinished)

    @property
    def warnings(self) -> list[str]:
        """What is missing or damaged, then the topics that cannot be read: everything else goes on."""
        return [*self._warnings, *filter(None, map(self.unreadable, sorted(self.topics)))]

    @property
    def further_warnings(self) -> list[str]:
        """The warnings other than ``unfinished``, for callers that have already reported that one.

        Damage is always among them.
        """
        return [w for w in self.warnings if w != self.unfinished or w == self._damage]

    @property
    def files(self) -> list[Path]:
        """The MCAP files that were read; more than one for a split bag."""
        return [file.path for file in self._files]

    @property
    def opened(self) -> list[McapFile]:
        """The files as they were scanned, with their header, channels and records."""
        return list(self._files)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(path.stat().st_size for path in self.files)

    @property
    def library(self) -> str:
        """What wrote the first file, according to the file."""
        return self._files[0].library

    def alterations(self) -> list[str]:
        """Return the topics and parts that differ from what the recorder wrote, by its digests."""
        return differing(self.digests, self.digested)

    def undigested(self) -> list[str]:
        """Return the topics and parts that no digest of the recorder covers."""
        return uncovered(self.digests, self.topics) + uncoverable(
            self.topics,
            sum(file.attachments for file in self._files),
            (name_of(kind) for file in self._files for kind in file.unknown),
        )

    @property
    def complete(self) -> bool:
        """True if the recorder marked the run as complete, and all of it was read and is unaltered."""
        marked = self.end is not None and self.end.get("complete") == "true"
        return self.sound and self._read_to_their_ends and marked

    @property
    def _read_to_their_ends(self) -> bool:
        return all(file.whole or file.data_end is not None for file in self._files)

    @property
    def damage(self) -> list[str]:
        """What keeps the files from being read to their end, or as many messages as counted."""
        damage = [f"{file.path.name}: {file.warning}" for file in self._files if file.warning]
        return damage or (
            [] if self.sound else [f"the number of messages is not the one in {METADATA}"]
        )

    @cached_property
    def seen_otherwise(self) -> list[str]:
        """What an index or a summary says otherwise than the data, a line each: other readers go by it.

        Files that were not read whole are read once more. Raises OSError.
        """
        return [
            finding.describe()
            for file in self._files
            for finding in structure(file)
            if finding.severity == ERROR and finding.message != file.warning
        ]

    @cached_property
    def digested(self) -> dict[str, str]:
        """The digests of what the file holds now."""
        digests = self._digests
        if digests is None:
            digests = RunningDigests()
            for file, content in self._contents(self.topics):
                digests.content(file.channels, content)
        for file in self._files:
            digests.header(file.profile, file.library)
            for channel in file.channels.values():
                digests.channel(channel, file.schemas.get(channel.schema_id))
            for name, values in file.metadata_records:
                digests.metadata(name, values)
            for _ in range(file.attachments):
                digests.attachment()
        return digests.values()

    def blocks(self, topics: Iterable[str]) -> Iterator[dict[str, Messages]]:
        """Yield the messages of some topics, block by block in file order.

        One pass: each block is decompressed once for all topics. A topic without messages in a block
        is not in its dictionary. Raises RecordingError for a topic that cannot be read.
        """
        asked = set(topics)
        for topic in asked & self.topics.keys():
            if reason := self.unreadable(topic):
                raise RecordingError(f"{self.path}: {reason}")
        return (
            messages
            for file, content in self._contents(asked)
            if (messages := file.by_topic(content, asked))
        )

    def copies(self, topics: Iterable[str]) -> Iterator[tuple[McapFile, Messages]]:
        """Yield the messages of some topics together, in file order, with their file."""
        asked = set(topics)
        for file, content in self._contents(asked):
            numbers = [n for n in content.channels if file.channels[n].topic in asked]
            messages = content.messages(numbers)
            if messages is not None:
                yield file, messages

    def _contents(self, topics: Collection[str]) -> Iterator[tuple[McapFile, Content]]:
        """Yield the blocks that have messages of some topics, each read once."""
        for number, file in enumerate(self._files):
            every = {channel for topic in topics for channel in file.numbers(topic)}
            with file.path.open("rb") as stream:
                for block in file.blocks:
                    if every.isdisjoint(block.channels):
                        continue
                    key = (number, block.offset)
                    content = self._kept.get(key) or file.content(stream, block)
                    self._keep(key, content)
                    yield file, content

    def _take_scanned(self, number: int, file: McapFile, offset: int, content: Content) -> None:
        if self._digests is not None:
            self._digests.content(file.channels, content)
        self._keep((number, offset), content)

    def _keep(self, key: tuple[int, int], content: Content) -> None:
        """Keep a block if there is room: every pass begins with the first ones."""
        cost = _cost(content)
        if key not in self._kept and self._kept_bytes + cost <= _KEPT:
            self._kept[key] = content
            self._kept_bytes += cost

    def _fill(self, topic: str, messages: Messages, parts: list[Piece]) -> None:
        if topic not in self._fillings:
            self._fillings[topic] = Filling(() if self._is_terms(topic) else None)
        try:
            self._fillings[topic].take(messages, parts)
        except ValueError as error:
            raise RecordingError(f"{self.path}: {topic} is too large: {error}") from None

    @staticmethod
    def _is_terms(topic: str) -> bool:
        """Return True for a controller's terms, of which an hour at 1 kHz has 370 MB."""
        return topic.endswith("/state")

    def messages(self, topic: str) -> Iterator[tuple[list[int], list[bytes]]]:
        """Yield ``(log times in ns, messages)`` of a topic, block by block, in the file's order."""
        for block in self.blocks([topic]):
            yield block[topic].log_time_ns.tolist(), block[topic].bytes()

    def unreadable(self, topic: str) -> str:
        """Return why a topic is not read, as a phrase with its name; empty if it can be, or is unknown."""
        about = self.topics.get(topic)
        return f"{topic} is not read: {about.unreadable}" if about and about.unreadable else ""

    def longest_gap_ns(self, topic: str) -> int:
        """Return the longest time between the log times of a topic's messages, in the order of these."""
        about = self.topics[topic]
        if about.ordered or about.unreadable:
            return about.longest_gap_ns
        log = np.concatenate([block[topic].log_time_ns for block in self.blocks([topic])])
        return int(np.diff(np.sort(log)).max(initial=0))

    def check_type(self, topic: str, type_name: str) -> None:
        """Raise RecordingError if messages of a topic are of another type."""
        if topic in self.topics and self.topics[topic].count:
            about = self.topics[topic]
            why = about.is_read() or f"its type is {about.type or 'not given'}"
            if about.type != type_name or about.is_read():
                raise RecordingError(f"{self.path}: {topic} cannot be read as {type_name}: {why}")

    def joints(self, topic: str) -> JointTable:
        """Return a JointState topic by its absolute name, empty for an unknown one. Raises as `tables`."""
        return self.tables({topic: None})[topic]

    def tables(self, wanted: Mapping[str, Collection[Column] | None]) -> dict[str, JointTable]:
        """Return JointState topics (absolute names), of each some columns, or all: None; read in one pass.

        Raises RecordingError for a topic of another type, for one that cannot be read, and if it has not as
        many messages as were counted when the recording was opened.
        """
        for topic in wanted:
            self.check_type(topic, names.JOINT_STATE_TYPE)
        nothing = Topic("")
        fillings = {
            topic: Filling(columns, about.count, about.size)
            for topic, columns in wanted.items()
            for about in [self.topics.get(topic, nothing)]
        }
        for block in self.blocks(wanted):
            for topic, messages in block.items():
                try:
                    fillings[topic].take(messages)
                except ValueError as error:
                    raise RecordingError(
                        f"{self.path}: {topic} cannot be read as JointState: {error}"
                    ) from None
                if len(fillings[topic]) > self.topics[topic].count:
                    return self._tables(fillings)  # raises
        return self._tables(fillings)

    def _tables(self, fillings: dict[str, Filling]) -> dict[str, JointTable]:
        tables: dict[str, JointTable] = {}
        for topic in list(fillings):
            filling = fillings.pop(topic)
            counted = self.topics[topic].count if topic in self.topics else 0
            if len(filling) != counted:
                raise RecordingError(
                    f"{self.path}: {topic} has {len(filling)} messages, {counted} were counted: "
                    "its index is wrong (trunk info --check) or the file has changed: open it again"
                )
            # Answers have the stamps of what they answer: they share memory.
            known = [table.stamp_ns for table in tables.values()]
            where = f"{self.path}: {topic}"
            tables[topic] = filling.table(topic, where, known)
        return tables

    def read_whole(self) -> None:
        """Make digests and tables in one pass, unless they were made while the file was read."""
        if self._whole:
            return
        digests = RunningDigests()
        try:
            for file, content in self._contents(self.topics):
                digests.content(file.channels, content)
                for topic, messages in file.by_topic(content).items():
                    about = self.topics[topic]
                    if about.type == names.JOINT_STATE_TYPE and not about.unreadable:
                        self._fill(topic, messages, pieces(messages))
        except RecordingError:
            self._fillings.clear()
            raise
        self._digests, self._whole = digests, True

    def filled(self) -> dict[str, JointTable]:
        """Return the JointState topics that were read in that pass, once.

        The values of controllers' terms are read again when needed.
        """
        fillings, self._fillings = self._fillings, {}
        kinds = {topic: filling.kinds for topic, filling in fillings.items()}
        whole = {
            topic: filling
            for topic, filling in fillings.items()
            if not self.unreadable(topic) and (not self._is_terms(topic) or len(kinds[topic]) == 1)
        }
        tables = self._tables(whole)
        for topic, table in tables.items():
            if self._is_terms(topic):
                (layout,) = kinds[topic]
                table.read_later(layout, partial(self._positions, topic))
        return tables

    def _positions(self, topic: str) -> Iterator[Floats]:
        for block in self.blocks([topic]):
            filling = Filling()
            filling.take(block[topic])
            yield filling.table("", "").position

    def joint_names(self, topic: str) -> tuple[str, ...]:
        """Return the names in a topic's first message; none without messages. Raises as `tables`."""
        self.check_type(topic, names.JOINT_STATE_TYPE)
        first = next(self.blocks([topic]), None)
        if first is None:
            return ()
        filling = Filling()
        filling.take(first[topic].only(0))
        return filling.table("", "").names

    def events(self, topic: str) -> list[RunEvent]:
        """Return events of nodes by log time; none of a topic that cannot be read, of which it warns."""
        return self._parsed(topic, names.DIAGNOSTIC_ARRAY_TYPE, parse_event)

    def parameter_messages(self, topic: str) -> list[ParameterChange]:
        """Return first sets and changes of parameters, as `events` does."""
        return self._parsed(topic, names.PARAMETER_EVENT_TYPE, parse_parameter_event)

    def _parsed(self, name: str, type_name: str, parse: Callable[[bytes], Parsed]) -> list[Parsed]:
        topic = self.topics.get(name)
        if topic is None:
            return []
        if topic.count and topic.type != type_name:
            topic.refuse(0, -1, f"its type is {topic.type or 'not given'}")
        if topic.unreadable:
            return []
        parsed: list[tuple[int, Parsed]] = []
        size = 0
        with _reading(self.path):
            for block in self.blocks([name]):
                messages = block[name]
                size += int((messages.end - messages.start).sum())
                if size > _TEXT:
                    topic.unreadable = (
                        f"its messages have more than the {_TEXT} bytes that are read"
                    )
                    return []
                for data, log_ns in zip(
                    messages.bytes(), messages.log_time_ns.tolist(), strict=True
                ):
                    try:
                        parsed.append((log_ns, parse(data)))
                    except ValueError as error:
                        topic.refuse(len(parsed), log_ns, str(error))
                        return []
        parsed.sort(key=lambda pair: pair[0])
        return [message for _, message in parsed]


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}: give a readable MCAP file") from None


def _cost(content: Content) -> int:
    """Return about how many bytes a block takes; offsets take as much as short messages."""
    return 2 * len(content.data) + 1000


def _report(progress: Callable[[int, int], None], before: int, of: int, done: int) -> None:
    progress(before + done, of)
