"""`JointTable`: a topic of JointState messages as columns, whose rows are found by stamp."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trunk_core.arrays import Floats, Integers
from trunk_core.errors import RecordingError
from trunk_core.samples import has_doubled
from trunk_core.units import NANOSECONDS, seconds

from .cdr import JointStateLayout, shared
from .messages import LIMIT, Messages

Frames = NDArray[np.int32]
Rows: TypeAlias = slice | Integers  # of some messages
Column = tuple[str, str]  # quantity, name
QUANTITIES = ("position", "velocity", "effort")
MAX_LAYOUTS = 256  # in a chunk: each is looked for in all its messages


class UnreadableError(ValueError):
    """A message that cannot be read: its row, and why."""

    def __init__(self, row: int, why: str) -> None:
        super().__init__(why)
        self.row = row


class Piece(NamedTuple):
    """Messages of one layout: their rows, and their fields, an array of the layout's ``dtype``."""

    rows: Rows
    layout: JointStateLayout
    fields: NDArray[Any]

    def is_finite(self) -> bool:
        """Return True if all values are finite."""
        return all(np.isfinite(self.fields[quantity]).all() for quantity in QUANTITIES)


def pieces(messages: Messages) -> list[Piece]:
    """Return some messages by their layouts, in the order in which these appear; no Python work a message.

    Raises UnreadableError for bytes that are not a little-endian JointState, or have not a value for each
    name, and for more than `MAX_LAYOUTS`.
    """
    data, _, start, end = messages
    sizes = end - start
    if not len(sizes):
        return []
    if (sizes == sizes[0]).all():
        layout = _layout_of(messages, 0)
        try:
            return [Piece(slice(0, len(sizes)), layout, layout.decode_at(data, start))]
        except ValueError:  # of one size, but of several layouts
            pass
    order = np.argsort(sizes, kind="stable")
    parts: list[Piece] = []
    for alike in np.split(order, np.flatnonzero(np.diff(sizes[order])) + 1):
        left = alike
        while len(left):
            layout = _layout_of(messages, int(left[0]))
            fits = layout.fits(data, start[left])
            rows, left = left[fits], left[~fits]
            parts.append(Piece(rows, layout, layout.decode_at(data, start[rows])))
            if len(parts) > MAX_LAYOUTS:
                raise UnreadableError(int(rows[0]), f"more than {MAX_LAYOUTS} layouts in a chunk")
    return sorted(parts, key=lambda part: int(part.rows[0]))  # type: ignore[index]


def _layout_of(messages: Messages, row: int) -> JointStateLayout:
    try:
        layout = shared(
            JointStateLayout.parse(messages.data[messages.start[row] : messages.end[row]])
        )
    except ValueError as error:
        raise UnreadableError(row, str(error)) from None
    if has_doubled(layout.name):
        raise UnreadableError(row, f"a name appears twice among {', '.join(layout.name)}"[:200])
    for quantity in QUANTITIES:
        if (count := getattr(layout, quantity)) not in (0, len(layout.name)):
            names = len(layout.name)
            raise UnreadableError(row, f"{count} values of {quantity} for {names} names")
    return layout


@dataclass
class JointTable:
    """N messages in the order of the file; of equal stamps the first row counts.

    A quantity is [N, names], NaN where a message does not carry it, or [N, 0] if none does.
    In real time a message's frame, ``frames[frame[i]]``, is the source that sent it.
    ``again``: reads the positions once more, block by block, where they take too much memory to be kept.
    """

    names: tuple[str, ...]
    stamp_ns: Integers  # [N], of the header
    log_time_ns: Integers  # [N], of the recording
    position: Floats
    velocity: Floats
    effort: Floats
    frames: tuple[str, ...] = ("",)
    frame: Frames = field(default_factory=lambda: np.zeros(0, np.int32))  # [N], index into `frames`
    topic: str = ""
    where: str = ""  # file and topic, as errors name them
    again: Callable[[], Iterator[Floats]] | None = None

    def __post_init__(self) -> None:
        """Without frames of its own, every message is in the first; this takes no memory."""
        if len(self.frame) < len(self):
            self.frame = np.broadcast_to(np.int32(0), (len(self),))
        self._layout: JointStateLayout | None = None
        self._window: tuple[int, Floats] = 0, np.empty((0, 0))
        self._coming: Iterator[Floats] | None = None

    def __len__(self) -> int:
        return len(self.stamp_ns)

    # Values.

    def width(self, quantity: str) -> int:
        """Return how many values of a quantity messages have; 0: it is in none of them."""
        if self._layout is not None:
            return int(getattr(self._layout, quantity))
        return int(getattr(self, quantity).shape[1])

    def read_later(self, layout: JointStateLayout, again: Callable[[], Iterator[Floats]]) -> None:
        """Read the positions when they are asked for, of messages that all have this layout."""
        self.names, self._layout = layout.name, layout
        self.again = again if layout.position else None

    def values(self, quantity: str, count: int | None = None) -> Floats:
        """Return all values of a quantity [N, names], or [N, 0] if no message carries it.

        Raises RecordingError unless there are ``count`` names, and a value for each.
        """
        if count is not None:
            self.check_width(quantity, count)
        if self.again is not None and quantity == "position":
            self.position, self.again = np.concatenate([*self.again()]), None
        values: Floats = getattr(self, quantity)
        return values

    def check_width(self, quantity: str, count: int) -> None:
        """Raise RecordingError unless messages have this many names, and a value of the quantity for each."""
        width = self.width(quantity)
        if not width == len(self.names) == count:
            raise RecordingError(
                f"{self.where}: {width} values of {quantity} for {len(self.names)} names, "
                f"{count} are needed: it cannot be recomputed"
            )

    def column(self, quantity: str, name: str) -> Floats:
        """Return one joint's values of a quantity [N]; NaN where it or the name is missing."""
        values = self.values(quantity)
        if name not in self.names or not values.shape[1]:
            return np.full(len(self), np.nan)
        return values[:, self.names.index(name)]

    def index(self, joint: str) -> int:
        """Return the index of a joint's values. Raises RecordingError if there is none."""
        if joint not in self.names:
            there = f"only {', '.join(self.names)}" if len(self) else "and no messages"
            raise RecordingError(
                f"{self.where} has no joint {joint!r}, {there}: it cannot be recomputed"
            )
        return self.names.index(joint)

    def positions(self, first: int, stop: int) -> Floats:
        """Return the positions [stop - first, names] of some rows.

        Values that were not kept are read again, block by block: fastest in ascending order.
        """
        if self.again is None:
            return self.position[first:stop]
        begin, held = self._window
        if self._coming is None or first < begin:
            begin, held, self._coming = 0, np.empty((0, len(self.names))), self.again()
        parts, end = [held], begin + len(held)
        while end < stop:
            part = next(self._coming, None)
            if part is None:
                raise RecordingError(f"{self.where}: the file has changed: open it again")
            parts.append(part)
            end += len(part)
            while begin + len(parts[0]) <= first and len(parts) > 1:
                begin += len(parts.pop(0))
        held = np.concatenate(parts)[first - begin :]
        self._window = first, held
        return held[: stop - first]

    # Rows.

    def rows(self, rows: Integers) -> JointTable:
        """Return some of the messages, in this order."""
        position, velocity, effort = (self.values(quantity)[rows] for quantity in QUANTITIES)
        return replace(
            self,
            stamp_ns=self.stamp_ns[rows],
            log_time_ns=self.log_time_ns[rows],
            position=position,
            velocity=velocity,
            effort=effort,
            frame=self.frame[rows] if len(self.frames) > 1 else self.frame[:0],
        )

    def by_stamp(self) -> JointTable:
        """Return the messages by increasing stamp, the first of those with equal stamps."""
        if self._ascends:
            return self
        _, rows = np.unique(self.stamp_ns, return_index=True)
        return self.rows(rows)

    def finite(self, columns: Collection[Column]) -> JointTable:
        """Return the messages in which all of these columns are finite."""
        there = np.ones(len(self), np.bool_)
        for column in columns:
            there &= np.isfinite(self.column(*column))
        return self.rows(np.flatnonzero(there)) if columns else self

    def only(self, names: Sequence[str], quantities: Collection[str]) -> JointTable:
        """Return quantities of some joints alone, from the messages that have finite ones of all of them.

        These are what a plant takes, whatever else messages carry.
        """
        there = self.finite([(quantity, name) for quantity in quantities for name in names])
        position, velocity, effort = (
            np.column_stack([there.column(quantity, name) for name in names])
            if quantity in quantities
            else np.zeros((len(there), 0))
            for quantity in QUANTITIES
        )
        return replace(
            there, names=tuple(names), position=position, velocity=velocity, effort=effort
        )

    @cached_property
    def _ascends(self) -> bool:
        return bool((self.stamp_ns[1:] > self.stamp_ns[:-1]).all())

    @cached_property
    def _by_stamp(self) -> tuple[Integers, Integers | None]:
        """The stamps in ascending order, and their rows; None: they are in order."""
        if self._ascends:
            return self.stamp_ns, None
        order = np.argsort(self.stamp_ns, kind="stable")
        return self.stamp_ns[order], order

    def rows_of(self, stamps: Integers, among: Integers | None = None) -> Integers:
        """Return the row of each stamp, of all rows or ``among`` some; -1 if there is none."""
        if among is None:
            known, rows = self._by_stamp
        else:
            order = np.argsort(self.stamp_ns[among], kind="stable")
            known, rows = self.stamp_ns[among][order], among[order]
        if not len(known):
            return np.full(len(stamps), -1)
        at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
        return np.where(known[at] == stamps, at if rows is None else rows[at], -1)

    def row(self, stamp_ns: int) -> int | None:
        """Return the first row with a stamp; None if there is none."""
        known, rows = self._by_stamp
        at = int(np.searchsorted(known, stamp_ns))
        if at == len(known) or known[at] != stamp_ns:
            return None
        return at if rows is None else int(rows[at])

    def __contains__(self, stamp_ns: int) -> bool:
        return self.row(stamp_ns) is not None

    def get(self, stamp_ns: int, quantity: str, count: int | None = None) -> list[float]:
        """Return a message's values of a quantity, one for each name; KeyError without the stamp.

        Raises RecordingError if they are not as many as the names, or as ``count``.
        """
        row = self.row(stamp_ns)
        if row is None:
            raise KeyError(stamp_ns)
        values: list[float] = self.values(quantity)[row].tolist()
        needed = len(self.names) if count is None else count
        if not len(values) == len(self.names) == needed:
            raise RecordingError(
                f"{self.where}: {len(values)} values of {quantity} for {len(self.names)} names at "
                f"t = {seconds(stamp_ns):g} s, {needed} are needed: it cannot be recomputed"
            )
        return values


class Filling:
    """Takes a topic's messages in their order, and makes a table of all columns, or ``only`` of some."""

    def __init__(
        self, only: Collection[Column] | None = None, capacity: int = 0, size: int = 0
    ) -> None:
        """``capacity``: as many messages are expected, of ``size`` bytes; more are taken, too."""
        self._only = None if only is None else frozenset(only)
        self._count = self._size = 0
        self._expected = size
        self._names: dict[str, int] = {}  # the column of each
        self._frames: dict[str, int] = {}
        self._frame: Frames | None = None  # where there is more than one
        self._stamp_ns: Integers = np.empty(capacity, np.int64)
        self._log_time_ns: Integers = np.empty(capacity, np.int64)
        self._values: dict[str, Floats] = {q: np.empty((capacity, 0)) for q in QUANTITIES}
        self._last: tuple[JointStateLayout, dict[str, list[tuple[int, int]] | None]] | None = None
        self.kinds: set[JointStateLayout] = set()  # the messages' layouts, apart from their frames

    def __len__(self) -> int:
        return self._count

    def take(self, messages: Messages, parts: Sequence[Piece] | None = None) -> None:
        """Take the next messages; ``parts``: these by layouts, as `pieces` gives and raises."""
        first, self._count = self._count, self._count + len(messages)
        self._size += int((messages.end - messages.start).sum())
        if self._count > len(self._stamp_ns):
            self._grow(max(self._count, len(self._stamp_ns) * 3 // 2, 1024))
        self._log_time_ns[first : self._count] = messages.log_time_ns
        for rows, layout, fields in pieces(messages) if parts is None else parts:
            self._put(
                slice(first, self._count) if isinstance(rows, slice) else first + rows,
                layout,
                fields,
            )

    def _put(self, rows: Rows, layout: JointStateLayout, fields: NDArray[Any]) -> None:
        self._stamp_ns[rows] = fields["sec"].astype(np.int64) * NANOSECONDS + fields["nanosec"]
        place = self._frames.setdefault(layout.frame_id, len(self._frames))
        if place and self._frame is None:
            self._frame = np.zeros(len(self._stamp_ns), np.int32)
        if self._frame is not None:
            self._frame[rows] = place
        if self._last is None or self._last[0] is not layout:
            self._last = layout, self._places(layout)
            self.kinds.add(replace(layout, frame_id=""))
        for quantity, values in self._values.items():
            columns = self._last[1].get(quantity, [])
            if columns is None:
                values[rows] = fields[quantity]
                continue
            if len(columns) < values.shape[1]:
                values[rows] = np.nan
            for column, place in columns:
                values[rows, column] = fields[quantity][:, place]

    def _places(self, layout: JointStateLayout) -> dict[str, list[tuple[int, int]] | None]:
        """Return, for each quantity of a layout, its columns here and there; None: all of them, in order."""
        wanted = [
            name
            for name in layout.name
            if self._only is None or any((q, name) in self._only for q in QUANTITIES)
        ]
        for name in wanted:
            self._names.setdefault(name, len(self._names))
        places: dict[str, list[tuple[int, int]] | None] = {}
        for quantity in QUANTITIES:
            carried = getattr(layout, quantity) and self._names
            asked = self._only is None or any(q == quantity for q, _ in self._only)
            if self._values[quantity].shape[1] or (carried and asked):
                self._widen(quantity, len(self._names))
            if carried and asked:
                columns = [(self._names[name], layout.name.index(name)) for name in wanted]
                alike = columns == [(place, place) for place in range(len(self._names))]
                alike = alike and len(columns) == getattr(layout, quantity)
                places[quantity] = None if alike else columns
        return places

    def _widen(self, quantity: str, width: int) -> None:
        values = self._values[quantity]
        if values.shape[1] < width:
            self._check(len(values), width)
            wide = np.empty((len(values), width))
            wide[:, : values.shape[1]] = values
            wide[: self._count, values.shape[1] :] = np.nan
            self._values[quantity] = wide

    def _check(self, rows: int, width: int) -> None:
        """Raise ValueError for a table that is far larger than what it is made of."""
        if rows * width * 8 > max(LIMIT, 16 * self._size, 16 * self._expected):
            raise ValueError(f"{rows} messages by {width} names are more than is read")

    def _grow(self, capacity: int) -> None:
        self._check(capacity, len(self._names))
        self._stamp_ns = _longer(self._stamp_ns, capacity)
        self._log_time_ns = _longer(self._log_time_ns, capacity)
        if self._frame is not None:
            self._frame = _longer(self._frame, capacity)
        self._values = {q: _longer(values, capacity) for q, values in self._values.items()}

    def table(self, topic: str, where: str, known: Sequence[Integers] = ()) -> JointTable:
        """Return the messages; stamps equal to ``known`` ones, and log times to stamps, share memory."""
        stamp_ns, log_time_ns = self._stamp_ns[: self._count], self._log_time_ns[: self._count]
        stamp_ns = next((same for same in known if np.array_equal(same, stamp_ns)), stamp_ns)
        if np.array_equal(stamp_ns, log_time_ns):
            log_time_ns = stamp_ns
        position, velocity, effort = (self._values[q][: self._count] for q in QUANTITIES)
        none = np.zeros(0, np.int32)
        return JointTable(
            tuple(self._names),
            stamp_ns,
            log_time_ns,
            position,
            velocity,
            effort,
            tuple(self._frames) or ("",),
            none if self._frame is None else self._frame[: self._count],
            topic,
            where,
        )


def _longer(rows: NDArray[Any], capacity: int) -> NDArray[Any]:
    """Return an array with room for more rows, which takes no memory until they are written."""
    longer = np.empty((capacity, *rows.shape[1:]), rows.dtype)
    longer[: len(rows)] = rows
    return longer
