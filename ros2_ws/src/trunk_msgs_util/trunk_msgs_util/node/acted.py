"""`ActedRecord`: what acted on the plant, as ``plant/inputs`` names it, against what is on record. Pure."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ..samples import JointSample
from ..source import ARRIVAL, sources_of_inputs
from ..topics import DISTURBANCE, EFFORT_COMMAND, INPUT_NAMES
from ..units import seconds

# A message is named by a row at the latest when it no longer acts; of each topic so many that no row has
# named are remembered, and so many that are named but not recorded.
_REMEMBERED = 100_000
_COMMAND, _DISTURBANCE = 0, 1  # where a row has their ages


class _Key(NamedTuple):
    """A message: the stamp first, so that older ones compare as smaller."""

    stamp_ns: int
    source: str  # empty: somebody else's


class _Topic:
    """One topic's messages: those that rows may still name, and those that rows have named in vain."""

    def __init__(self) -> None:
        self._recorded: OrderedDict[_Key, None] = OrderedDict()
        self._named: _Key | None = None
        self._missing: OrderedDict[_Key, None] = OrderedDict()

    def record(self, key: _Key) -> None:
        """Take a message that is on record."""
        if key in self._missing:
            del self._missing[key]
        else:
            self._recorded[key] = None
            if len(self._recorded) > _REMEMBERED:
                self._recorded.popitem(last=False)

    def name(self, key: _Key) -> None:
        """Take what a row names: the rows' stamps increase, and what is older is never named again."""
        if key == self._named:
            return
        self._named = key
        if key not in self._recorded:
            if len(self._missing) < _REMEMBERED:
                self._missing[key] = None
            return
        while next(iter(self._recorded)) < key:
            self._recorded.popitem(last=False)

    def rename(self, simulator: str) -> None:
        """Take what was recorded under the simulator's source, before that was known, as a stranger's."""
        for key in [key for key in self._recorded if key.source == simulator]:
            del self._recorded[key]
            self.record(_Key(key.stamp_ns, ""))

    def missing(self) -> list[_Key]:
        """Return the messages that were in force but are not on record, in order."""
        return sorted(self._missing)


class _Arrivals:
    """Commands that act from their arrival: a row names their torque alone."""

    def __init__(self) -> None:
        self._recorded: OrderedDict[float, None] = OrderedDict()
        self._missing: OrderedDict[float, int] = OrderedDict()  # with the stamp of the first row

    def record(self, effort: float) -> None:
        """Take one that is on record."""
        self._missing.pop(effort, None)
        self._recorded[effort] = None
        self._recorded.move_to_end(effort)
        if len(self._recorded) > _REMEMBERED:
            self._recorded.popitem(last=False)

    def name(self, effort: float, stamp_ns: int) -> None:
        """Take what a row names."""
        if effort not in self._recorded and len(self._missing) < _REMEMBERED:
            self._missing.setdefault(effort, stamp_ns)

    def missing(self) -> list[_Key]:
        """Return the messages that were in force but are not on record, in order."""
        return sorted(_Key(stamp_ns, "") for stamp_ns in self._missing.values())


class ActedRecord:
    """Takes rows, commands and disturbances in any order."""

    def __init__(self) -> None:
        self._topics = {EFFORT_COMMAND: _Topic(), DISTURBANCE: _Topic()}
        self._arrivals = _Arrivals()
        self._simulator = ""  # the rows' source

    def record(self, topic: str, stamp_ns: int, source: str) -> None:
        """Take a message that is on record; the topic may be any."""
        if topic in self._topics:
            named = "" if self.is_stranger(source) else source
            self._topics[topic].record(_Key(stamp_ns, named))

    def is_stranger(self, source: str) -> bool:
        """Return True for a command or disturbance that no node of ours sent.

        Its sender may have copied the state's whole header, and with it the simulator's source.
        """
        return source in ("", self._simulator)

    def record_efforts(self, efforts: Iterable[float]) -> None:
        """Take the torques, N m, of a command that is no node's of ours, on record."""
        for effort in efforts:
            self._arrivals.record(effort)

    def row(self, sample: JointSample, frame_id: str) -> None:
        """Take a row of ``plant/inputs``. Raises ValueError for one that no simulator of ours sends."""
        sources = sources_of_inputs(frame_id)
        if (
            sources is None
            or sample.name != INPUT_NAMES
            or len(sample.velocity) != len(sample.name)
        ):
            raise ValueError("not a row of plant/inputs")
        if self._simulator != sources[0]:
            self._simulator = sources[0]
            for topic in self._topics.values():
                topic.rename(self._simulator)
        ages = sample.velocity[_COMMAND], sample.velocity[_DISTURBANCE]
        for topic, source, age in zip(self._topics.values(), sources[1:], ages, strict=True):
            if age >= 0.0 and source == ARRIVAL:
                self._arrivals.name(sample.position[_COMMAND], sample.stamp_ns)
            elif age >= 0.0:
                topic.name(_Key(sample.stamp_ns - int(age), source))

    def missing(self) -> Iterator[str]:
        """Yield the topics whose messages acted but are not on record, a line each."""
        missing = [(name, topic.missing()) for name, topic in self._topics.items()]
        for name, keys in (*missing, (EFFORT_COMMAND, self._arrivals.missing())):
            if keys:
                stamp_ns, source = keys[0]
                sender = source or "a node that is not ours"
                more = f" (and {len(keys) - 1} more)" if len(keys) > 1 else ""
                yield (
                    f"{name}: a message of {sender} acted on the plant, stamped t = "
                    f"{seconds(stamp_ns):g} s, but was not recorded{more}"
                )
