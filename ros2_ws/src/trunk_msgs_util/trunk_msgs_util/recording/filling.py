"""A regular JointState topic read block by block into arrays of full length, while others are read too."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .joint_arrays import (
    QUANTITIES,
    Floats,
    Frames,
    Integers,
    JointArrays,
    all_of_the_first,
    groups,
    stamps,
    structured,
)
from .limits import MAX_LAYOUTS, LimitError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .joint_state_cdr import JointStateLayout
    from .messages import Messages


class Filling:
    """Takes a topic's messages in their order. ``regular``: all have the same names and quantities.

    Their frames may differ, as where another controller takes over.
    """

    def __init__(self, count: int, values: bool) -> None:
        """Expect ``count`` messages; without ``values``, only their stamps and what is in each are kept."""
        self.regular = True
        self.names: tuple[str, ...] = ()
        self.widths: dict[str, int] = {}
        self._values: dict[str, Floats] | None = {} if values else None
        self._count, self._found = count, 0
        self._stamp_ns: Integers = np.empty(count, np.int64)
        self._log_time_ns: Integers = np.empty(count, np.int64)
        self._frames: dict[str, int] = {}
        self._frame: Frames | None = None  # made where there is more than one frame

    def take(self, messages: Messages) -> None:
        """Take the next messages."""
        first = self._found
        self._found += len(messages)
        self.regular = self.regular and self._found <= self._count
        if not self.regular:
            return
        self._log_time_ns[first : self._found] = messages.log_time_ns
        found = structured(messages)
        if found is not None:
            self._put(slice(first, self._found), *found)
            return
        try:
            layouts, strange = groups(messages)
        except LimitError:
            self.regular = False
            return
        self.regular = not strange
        for layout, rows in layouts:
            if self.regular:
                array = layout.decode_at(messages.data, messages.start[rows])
                self._put(first + rows, layout, array)

    def _put(self, rows: slice | Integers, layout: JointStateLayout, array: NDArray[Any]) -> None:
        """Put messages of one layout into these rows."""
        widths = {quantity: int(getattr(layout, quantity)) for quantity in QUANTITIES}
        if not self.widths:
            self._begin(layout.name, widths)
        place = self._frames.setdefault(layout.frame_id, len(self._frames))
        if (layout.name, widths) != (self.names, self.widths) or place >= MAX_LAYOUTS:
            self.regular = False
            return
        if place and self._frame is None:
            self._frame = np.zeros(self._count, np.int32)
        if self._frame is not None:
            self._frame[rows] = place
        self._stamp_ns[rows] = stamps(array)
        for quantity, values in (self._values or {}).items():
            values[rows] = array[quantity]

    def _begin(self, names: tuple[str, ...], widths: dict[str, int]) -> None:
        self.names, self.widths = names, widths
        self.regular = all(width in (0, len(names)) for width in widths.values())
        if self._values is not None:
            self._values = {q: np.empty((self._count, width)) for q, width in widths.items()}

    @property
    def whole(self) -> bool:
        """True if the topic is regular, and as many messages came as were expected."""
        return self.regular and 0 < self._found == self._count

    def is_effort_of(self, joint: str | None) -> bool:
        """Return True if each message is a finite effort of this joint."""
        values = None if self._values is None else self._values["effort"]
        alone = self.names == (joint,) and self.widths["effort"] == 1
        return alone and values is not None and bool(np.isfinite(values).all())

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that the messages have."""
        return tuple(self._frames)

    @property
    def frame(self) -> Frames:
        """Each message's frame [N], an index into `frames`."""
        return all_of_the_first(self._count) if self._frame is None else self._frame

    def times(self, known: Integers | None) -> tuple[Integers, Integers]:
        """Return stamps and log times [N], in ns; equal ones, also to those ``known``, share their memory."""
        stamp_ns, log_ns = self._stamp_ns, self._log_time_ns
        if known is not None and np.array_equal(stamp_ns, known):
            stamp_ns = known
        return stamp_ns, stamp_ns if np.array_equal(stamp_ns, log_ns) else log_ns

    def arrays(self, stamp_ns: Integers, log_ns: Integers) -> JointArrays | None:
        """Return the messages, with the times of `times`; None if their values were not kept."""
        if self._values is None:
            return None
        position, velocity, effort = (self._values[q] for q in QUANTITIES)
        return JointArrays(
            self.names, stamp_ns, log_ns, position, velocity, effort, self.frames, self.frame
        )
