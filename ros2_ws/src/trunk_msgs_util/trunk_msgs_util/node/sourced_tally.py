"""`SourcedTally`: whether a recording in real time is whole, where each message names its source."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from .. import topics
from ..recording.joint_state_cdr import frame_in
from ..source import source_in, sources_of_inputs
from .acted import ActedRecord
from .conversions import WireReader
from .tally import NO_COMMAND, OF_STATES, Tally

_OF_STATES = (*OF_STATES, topics.PLANT_INPUTS)


class SourcedTally(Tally):
    """Counts the messages of each source, and looks for everything that acted on the plant.

    What acted on nothing may be missing, if no node of ours has counted it: a stranger's message, or the last
    ones of a node that was killed.
    """

    def __init__(self, name_of: Callable[[str], str]) -> None:
        super().__init__(name_of)
        self._of: Counter[tuple[str, str]] = Counter()  # messages, by source and relative topic
        self._acted = ActedRecord()
        self._read_row = WireReader()
        self._read_command = WireReader()

    def take(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Take a message that is on record. Raises ValueError for inputs that no simulator of ours sends."""
        super().take(topic, stamp_ns, data)
        frame = frame_in(data)
        if topic == topics.PLANT_INPUTS:
            self._acted.row(self._read_row(data), frame)
            sources = sources_of_inputs(frame)
            self._of[sources[0] if sources else "", topic] += 1
        else:
            source = source_in(frame)
            self._of[source, topic] += 1
            self._acted.record(topic, stamp_ns, source)
            if topic == topics.EFFORT_COMMAND and self._acted.is_stranger(source):
                self._acted.record_efforts(self._read_command(data).effort)

    def _lacking(self, heard: Sequence[str], unheard: Sequence[str]) -> Iterator[str]:
        yield from self._without_states(_OF_STATES, _OF_STATES)
        missing = list(self._acted.missing())
        if missing and not self.counts[topics.EFFORT_COMMAND]:
            yield NO_COMMAND
        yield from missing
        yield from self._without_events()
        yield from self._without_messages(heard)

    def _count_of_run(self, topic: str) -> int:
        return self._of[self.end.source if self.end else "", topic]

    def _count_of(self, source: str, topic: str) -> int:
        return self._of[source, topic]
