"""`Pictures`: what a recorder hears, as the pictures that it records for 3-D views."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial

from .. import topics
from ..picture.film import Film, value
from ..recording.schemas import ParameterChange
from .conversions import WireReader

_TERMS = "terms"  # those of the controller heard last
_OF_A_PLANT = "plant.length"  # a parameter that no other node has


class Pictures:
    """Keeps the newest message of what a picture shows, as bytes; only what is drawn is parsed."""

    def __init__(self) -> None:
        self._film = Film()
        self._newest: dict[str, bytes] = {}
        self._read: defaultdict[str, WireReader] = defaultdict(WireReader)

    def taking(self, topic: str) -> Callable[[bytes], None] | None:
        """Return what takes a topic's messages; None for a topic that no picture shows."""
        if topic == topics.DISTURBANCE:
            return partial(self._newest.__setitem__, topic)
        if topics.is_controller_state(topic):
            return partial(self._newest.__setitem__, _TERMS)
        return None

    def retune(self, change: ParameterChange) -> None:
        """Take a node's parameters."""
        for values in (change.new, change.changed):
            if _OF_A_PLANT in values:
                self._film.retune(values)

    def of(self, stamp_ns: int, truth: bytes, log_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield the topics and messages of a true state's picture; none for a state that is not drawn."""
        if not self._film.is_due(stamp_ns):
            return
        read = {name: self._read[name](data) for name, data in self._newest.items()}
        state = self._read[topics.GROUND_TRUTH](truth)
        reference = value(read.get(_TERMS), "position", "reference")
        yield from self._film.picture(state, read.get(topics.DISTURBANCE), reference, log_ns)
