"""`Recording`: the content of a run's MCAP file or rosbag2 folder, as far as it is sound."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

from .. import topics as names
from ..events import Event
from .joint_arrays import JointArrays, concatenate, decode
from .limits import MAX_TEXT
from .schemas import ParameterChange, RunEvent, parse_event, parse_parameter_event
from .store import RecordedFiles
from .topic import RecordingError, Topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

    from ..samples import Value

__all__ = ["Recording", "RecordingError", "Topic"]

Parsed = TypeVar("Parsed")
_RUN = names.RUN_EVENTS.rpartition("/")[0] + "/"


class Recording(RecordedFiles):
    """A run's recording: its files, and what our nodes' messages in them say."""

    @classmethod
    def open(
        cls, path: str | Path, progress: Callable[[int, int], None] = lambda _done, _of: None
    ) -> Recording:
        """Scan a file or a folder; ``progress`` is called with the bytes read and the total.

        Raises RecordingError if it is missing, not readable, or not MCAP.
        """
        return cls(path)._opened(progress)

    @classmethod
    def open_by_summary(
        cls, path: str | Path, progress: Callable[[int, int], None] = lambda _done, _of: None
    ) -> Recording:
        """Open a recording by its summary and indexes; ``checked`` is False if that was enough.

        Files of less than `_BY_SUMMARY` bytes, and those without a sound summary, are scanned.
        Raises as `open` does.
        """
        recording = cls(path)
        recording.checked = False
        return recording._opened(progress)

    def _opened(self, progress: Callable[[int, int], None]) -> Recording:
        try:
            self._scan(progress)
            self._look_at_messages()
        except OSError as error:
            raise RecordingError(
                f"{self.path}: {error.strerror}: give a readable MCAP file"
            ) from None
        return self

    def _look_at_messages(self) -> None:
        """Warn of messages that cannot be read: everything else goes on without them."""
        for relative, read in (
            (names.RUN_PARAMETERS, lambda: self._parameter_events),
            (names.RUN_EVENTS, lambda: self._events),
        ):
            if self.topic(relative) in self.topics:
                with suppress(RecordingError):  # raised again when it is asked for
                    read()
        self.warnings += [
            topic.unreadable.describe(name, topic.count)
            for name, topic in sorted(self.topics.items())
            if topic.unreadable.count or topic.unreadable.limit is not None
        ]

    @cached_property
    def namespace(self) -> str:
        """The namespace of the run, as ``/robot``; empty for the root."""
        suffix = f"/{names.GROUND_TRUTH}"
        return next((t.removesuffix(suffix) for t in self.topics if t.endswith(suffix)), "")

    def topic(self, relative: str) -> str:
        """Return the absolute name of a topic or node; an absolute one is returned as it is.

        A node goes by its kind: ``pid/state`` is that topic of the PID even if the node has another name.
        """
        if relative.startswith("/"):
            return relative
        node, slash, rest = relative.partition("/")
        if not relative.startswith(_RUN):
            node = self.renamed.get(node, node)
        return f"{self.namespace}/{node}{slash}{rest}"

    def relative(self, name: str) -> str:
        """Return the name for which `topic` returns this one; it stays absolute outside of the run."""
        prefix = f"{self.namespace}/"
        if not name.startswith(prefix):
            return name
        node, slash, rest = name.removeprefix(prefix).partition("/")
        kind = next((kind for kind, own in self.renamed.items() if own == node), node)
        return f"{kind}{slash}{rest}"

    @cached_property
    def renamed(self) -> dict[str, str]:
        """The names of nodes by the kind of node that they report, where the two differ.

        A kind is left out if several nodes are of it, or if some node has its name.
        """
        prefix = f"{self.namespace}/"
        kinds: dict[str, set[str]] = {}
        known: set[str] = set()
        with suppress(RecordingError):
            known |= {change.node for change in self._parameter_events}
            for event in self._events:
                known.add(event.node)
                kind = event.values.get("kind") if event.message == Event.CONFIGURED else None
                if kind and event.node.startswith(prefix):
                    kinds.setdefault(kind, set()).add(event.node.removeprefix(prefix))
        return {
            kind: min(own)
            for kind, own in kinds.items()
            if len(own) == 1 and prefix + kind not in known
        }

    @property
    def controller(self) -> str | None:
        """The node whose ``~/state`` was recorded; of several, the one with most messages."""
        counts = self._controllers
        return max(counts, key=lambda name: counts[name], default=None)

    @property
    def controllers(self) -> list[str]:
        """All nodes whose ``~/state`` was recorded, in the plan's order."""
        counts = self._controllers
        planned = self.provenance.get("controller", "").split()
        return sorted(
            counts, key=lambda name: planned.index(name) if name in planned else len(planned)
        )

    @cached_property
    def _controllers(self) -> dict[str, int]:
        prefix, suffix = f"{self.namespace}/", "/state"
        return {
            self.relative(name).removesuffix(suffix): topic.readable
            for name, topic in self.topics.items()
            if topic.readable and name.startswith(prefix) and name.endswith(suffix)
        }

    @property
    def fell_at_ns(self) -> int | None:
        """When the trunk fell, by the run's events; None if they report no fall."""
        return next((e.stamp_ns for e in self.events() if e.message == Event.FELL), None)

    def joints(self, topic: str) -> JointArrays:
        """Return all readable messages of a JointState topic (absolute name), none for an unknown topic.

        Raises RecordingError for a topic of another type, and for one beyond a limit.
        """
        return self.joints_of([topic])[topic]

    def joints_of(self, topics: Iterable[str]) -> Mapping[str, JointArrays]:
        """Return all messages of some JointState topics, read in one pass. Raises as `joints` does."""
        parts: dict[str, list[JointArrays]] = {topic: [] for topic in topics}
        for topic in parts:
            self.check_type(topic, names.JOINT_STATE_TYPE)
        for block in self.blocks(parts):
            for topic, messages in block.items():
                try:
                    parts[topic].append(decode(messages))
                except (ValueError, OverflowError) as error:
                    raise RecordingError(
                        f"{self.path}: {topic} cannot be read as JointState: {error}"
                    ) from None
        return {topic: concatenate(parts.pop(topic)) for topic in list(parts)}

    def _parsed(
        self, relative: str, type_name: str, parse: Callable[[bytes], Parsed]
    ) -> list[Parsed]:
        """Return a topic's messages that can be read, by log time, and note the others.

        Raises RecordingError.
        """
        name = self.topic(relative)
        topic = self.topics.get(name)
        parsed: list[tuple[int, Parsed]] = []
        if topic is None:
            return []
        if topic.unreadable.limit is not None:
            raise RecordingError(f"{self.path}: {topic.unreadable.describe(name, topic.count)}")
        index = size = 0
        for file, block, channels, content in self._contents([name]):
            messages = content.messages(sorted(channels & content.channels.keys()))
            if messages is None:
                continue
            size += int((messages.end - messages.start).sum())
            if size > MAX_TEXT:
                topic.unreadable.limit = f"its messages have more than the {MAX_TEXT} bytes allowed"
                raise RecordingError(f"{self.path}: {topic.unreadable.describe(name, topic.count)}")
            bad: list[int] = []
            for row, data in enumerate(messages.bytes()):
                if messages.log_time_ns[row] < 0:  # counted when the file was scanned
                    continue
                try:
                    if topic.type != type_name:
                        raise ValueError(f"its type is {topic.type or 'not given'}")
                    parsed.append((int(messages.log_time_ns[row]), parse(data)))
                except ValueError as error:
                    topic.unreadable.add(index + row, int(messages.log_time_ns[row]), str(error))
                    bad.append(row)
            file.leave_out(block.offset, messages, bad)
            index += len(messages)
        if not topic.ordered:
            parsed.sort(key=lambda pair: pair[0])
        return [message for _, message in parsed]

    @cached_property
    def _parameter_events(self) -> list[ParameterChange]:
        return self._parsed(names.RUN_PARAMETERS, names.PARAMETER_EVENT_TYPE, parse_parameter_event)

    @cached_property
    def _events(self) -> list[RunEvent]:
        return self._parsed(names.RUN_EVENTS, names.DIAGNOSTIC_ARRAY_TYPE, parse_event)

    def parameters(self) -> dict[str, dict[str, Value]]:
        """Return every node's first full set of parameters, by its fully qualified name."""
        first_sets: dict[str, dict[str, Value]] = {}
        for event in self._parameter_events:
            if event.new:
                first_sets.setdefault(event.node, event.new)
        return first_sets

    def parameter_messages(self) -> list[ParameterChange]:
        """Return all messages on ``run/parameters`` by log time."""
        return list(self._parameter_events)

    def parameter_changes(self) -> list[ParameterChange]:
        """Return the changes during the run; each applies to states with a later stamp."""
        return [event for event in self._parameter_events if event.changed]

    def events(self) -> list[RunEvent]:
        """Return the run's events by log time."""
        return list(self._events)
