"""What a branch has in common with its parent: the messages before it, copied byte for byte."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import declarations
from trunk_msgs_util.recording.file import RecordingFile
from trunk_msgs_util.recording.joint_arrays import Integers
from trunk_msgs_util.recording.messages import Messages, unaligned
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.recording.schemas import parameter_event, parse_parameter_event
from trunk_msgs_util.recording.topic import STAMPED
from trunk_msgs_util.recording.writer import RecordingWriter
from trunk_msgs_util.recording.writing.interleaved import Rows

from ..plans.nodes import NODES
from ..recorded.message_stamps import message_stamps
from ..recorded.run import RecordedRun

Replaced = Mapping[str, Mapping[str, Any]]  # parameters with other initial values, by node


class Past:
    """The parent's messages stamped before a branch, those without a stamp by their log time."""

    def __init__(self, run: RecordedRun, stamp_ns: int, replaced: Replaced) -> None:
        self._run, self._stamp_ns, self._replaced = run, stamp_ns, replaced
        truth = run.table(topics.GROUND_TRUTH)
        self._last_ns = int(truth.stamp_ns.max())
        self._log_ns = int(truth.log_time_ns[truth.stamp_ns == stamp_ns][0])

    @property
    def ahead_ns(self) -> int:
        """By how much the log times are ahead of the stamps at the branch."""
        return self._log_ns - max(self._stamp_ns, 0)

    def copy(self, writer: RecordingWriter) -> None:
        """Write the messages. Raises RecordingError for a topic of a type that cannot be written."""
        recording = self._run.recording
        numbers: dict[str, int] = {}
        for name, topic in recording.topics.items():
            if self._began_later(name):
                continue
            try:
                numbers[name] = writer.channel(name, topic.type)
            except ValueError as error:
                raise RecordingError(
                    f"{recording.path}: {name} cannot be copied: {error}"
                ) from None
        for source, messages in recording.copies(list(recording.topics)):
            writer.write_rows(list(self._rows(source, messages, numbers)))

    def _began_later(self, name: str) -> bool:
        """Return True for a topic whose channel begins with its first message, if that comes later."""
        relative = self._run.recording.relative(name)
        own = relative == topics.OPERATOR_PUSH or topics.is_own_reference(relative)
        return own and not (self._run.table(relative).stamp_ns < self._stamp_ns).any()

    def _rows(
        self, source: RecordingFile, messages: Messages, numbers: Mapping[str, int]
    ) -> Iterator[Rows]:
        """Yield the messages of a block that belong to the past, in their order."""
        channels = messages.channels()
        before = self._before(source, messages, channels)
        parameters = self._run.recording.topic(topics.RUN_PARAMETERS)
        sizes = messages.end - messages.start
        for channel in np.unique(channels[before]).tolist():
            name = source.channels[channel].topic
            rows = np.flatnonzero(before & (channels == channel))
            size = int(sizes[rows[0]])
            if name != parameters and (sizes[rows] == size).all():
                data = unaligned(messages.data, f"V{size}")[messages.start[rows]]
                yield Rows(numbers[name], rows, messages.log_time_ns[rows], data)
                continue
            for row in rows.tolist():
                message = messages.data[int(messages.start[row]) : int(messages.end[row])]
                if name == parameters:
                    message = self._parameters(message)
                data = np.frombuffer(message, f"V{len(message)}")
                at = np.array([row])
                yield Rows(numbers[name], at, messages.log_time_ns[at], data)

    def _before(self, source: RecordingFile, messages: Messages, channels: Integers) -> Any:
        stamps = message_stamps(source, messages, channels)
        stamped = [c for c in np.unique(channels).tolist() if source.type_of(c) in STAMPED]
        known = np.isin(channels, stamped)
        before = np.where(known, stamps < self._stamp_ns, messages.log_time_ns < self._log_ns)
        if self._run.external:  # a stamp of no state says nothing about when its command acted
            commands = self._run.recording.topic(topics.EFFORT_COMMAND)
            given = [c for c, channel in source.channels.items() if channel.topic == commands]
            period_ns = self._run.config("simulator").period_ns
            odd = np.isin(channels, given) & ((stamps <= 0) | (stamps % period_ns != 0))
            odd |= np.isin(channels, given) & (stamps > self._last_ns)
            before = np.where(odd, messages.log_time_ns < self._log_ns, before)
        # Sets of parameters are stamped 0 and belong to any past, unlike changes at that time.
        name = self._run.recording.topic(topics.RUN_PARAMETERS)
        for row in np.flatnonzero(~before & (stamps == 0)).tolist():
            if source.channels[int(channels[row])].topic == name:
                data = messages.data[int(messages.start[row]) : int(messages.end[row])]
                before[row] = bool(parse_parameter_event(data).new)
        return before

    def _parameters(self, data: bytes) -> bytes:
        """Return a message on ``run/parameters``, with other values where the branch begins with them."""
        change = parse_parameter_event(data)
        node = self._run.recording.relative(change.node)
        if not change.new or node not in self._replaced:
            return data
        kinds = {name: d.kind for name, d in declarations(NODES[node].config).items()}
        new = {**change.new, **self._replaced[node]}
        return parameter_event(change.stamp_ns, change.node, new, {}, kinds, change.source)
