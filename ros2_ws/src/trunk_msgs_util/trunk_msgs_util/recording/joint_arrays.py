"""`JointArrays`: a topic of JointState messages as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..samples import JointSample, has_doubled
from ..topics import JOINT_STATE_TYPE
from ..units import LAST_STAMP_NS, NANOSECONDS
from .joint_state_cdr import JointStateLayout, layout_of, shared
from .limits import MAX_JOINTS, MAX_LAYOUTS, MAX_NAME, LimitError
from .schemas import deserialize, stamp_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .messages import Messages

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Frames = NDArray[np.int32]
Rows: TypeAlias = slice | Integers  # of some messages
QUANTITIES = ("position", "velocity", "effort")
_MAX_UNUSUAL_BYTES = 1 << 20  # of a message that is read one by one
_LAST_SEC = LAST_STAMP_NS // NANOSECONDS
_ALL_OF_THE_FIRST: Frames = np.zeros(0, np.int32)


@dataclass(frozen=True)
class JointArrays:
    """N messages in the order of the file.

    A quantity is [N, names], NaN where a message does not carry it, or [N, 0] if none does.
    In real time a message's frame, ``frames[frame[i]]``, is the source that sent it.
    """

    names: tuple[str, ...]
    stamp_ns: Integers  # [N], of the header
    log_time_ns: Integers  # [N], of the recording
    position: Floats
    velocity: Floats
    effort: Floats
    frames: tuple[str, ...] = ("",)
    frame: Frames = field(default_factory=lambda: _ALL_OF_THE_FIRST)  # [N], index into `frames`

    def __post_init__(self) -> None:
        """Without frames of its own, every message is in the first; this takes no memory."""
        if self.frame is _ALL_OF_THE_FIRST:
            object.__setattr__(self, "frame", all_of_the_first(len(self)))

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def column(self, quantity: str, name: str) -> Floats:
        """Return one joint's values of a quantity [N]; NaN where it or the name is missing."""
        values: Floats = getattr(self, quantity)
        if name not in self.names or not values.shape[1]:
            return np.full(len(self), np.nan)
        return values[:, self.names.index(name)]

    def by_stamp(self) -> JointArrays:
        """Return the messages by increasing stamp, the first of those with equal stamps."""
        if (np.diff(self.stamp_ns) > 0).all():
            return self
        _, rows = np.unique(self.stamp_ns, return_index=True)
        return self.rows(rows)

    def rows(self, rows: Integers) -> JointArrays:
        """Return some of the messages, in this order."""
        position, velocity, effort = (getattr(self, quantity)[rows] for quantity in QUANTITIES)
        stamp_ns, log_time_ns = self.stamp_ns[rows], self.log_time_ns[rows]
        frame = self.frame[rows] if len(self.frames) > 1 else _ALL_OF_THE_FIRST
        return JointArrays(
            self.names, stamp_ns, log_time_ns, position, velocity, effort, self.frames, frame
        )


def all_of_the_first(count: int) -> Frames:
    """Return the frames [N] of messages that have one frame in common, without memory for each."""
    return np.broadcast_to(np.int32(0), (count,))


def structured(messages: Messages) -> tuple[JointStateLayout, NDArray[Any]] | None:
    """Return the layout and an array of fields sec, nanosec, position, velocity, effort.

    No Python work per message; a quantity is [N, values]. None if the messages do not all
    share one layout, or are big-endian or malformed.
    """
    data, _, start, end = messages
    sizes = end - start
    if (sizes != sizes[0]).any():
        return None
    try:
        layout = shared(JointStateLayout.parse(data[start[0] : end[0]]))
        return layout, layout.decode_at(data, start)
    except ValueError:
        return None


def stamps(array: NDArray[Any]) -> Integers:
    """Return the stamps in ns of what `structured` returns."""
    stamp_ns: Integers = array["sec"].astype(np.int64) * NANOSECONDS + array["nanosec"]
    return stamp_ns


def groups(messages: Messages) -> tuple[list[tuple[JointStateLayout, Integers]], list[int]]:
    """Return the layouts of one or more messages with their rows, and the rows that have none.

    Those are big-endian or malformed. Raises LimitError beyond `MAX_LAYOUTS`.
    """
    data, _, start, end = messages
    sizes = end - start
    order = np.argsort(sizes, kind="stable")
    layouts: list[tuple[JointStateLayout, Integers]] = []
    strange: list[int] = []
    for rows in np.split(order, np.flatnonzero(np.diff(sizes[order])) + 1):
        left = rows
        while len(left):
            first = int(left[0])
            try:
                layout = shared(JointStateLayout.parse(data[start[first] : end[first]]))
                fits = layout.fits(data, start[left])
            except ValueError:
                strange.append(first)
                left = left[1:]
                continue
            layouts.append((layout, left[fits]))
            left = left[~fits]
            if len(layouts) > MAX_LAYOUTS:
                raise LimitError(f"its messages have more than {MAX_LAYOUTS} layouts")
    return sorted(layouts, key=lambda group: int(group[1][0])), sorted(strange)


def misfit(layout: JointStateLayout) -> str:
    """Return why values do not match names; empty if they do."""
    if has_doubled(layout.name):
        return f"a name appears twice among {', '.join(layout.name)}"[:200]
    try:
        check_counts(layout)
    except ValueError as error:
        return str(error)
    return ""


def check_counts(layout: JointStateLayout) -> None:
    """Raise ValueError unless each quantity has a value for each name, or none at all."""
    names = len(layout.name)
    for quantity in QUANTITIES:
        count = getattr(layout, quantity)
        if count not in (0, names):
            raise ValueError(f"{count} values of {quantity} for {names} names")


def pieces(
    messages: Messages, skip_unreadable: bool = False
) -> Iterator[tuple[Rows, JointStateLayout, NDArray[Any]]]:
    """Yield the messages of each layout in turn: their rows, the layout, their fields as in `structured`.

    A message that no layout describes comes alone, with that of its content. Raises ValueError for bytes
    that are not JointState, unless they are to be skipped, and LimitError beyond `MAX_LAYOUTS`.
    """
    whole = structured(messages)
    if whole is not None:
        yield slice(0, len(messages)), *whole
        return
    regular, strange = groups(messages)
    for layout, rows in regular:
        yield rows, layout, layout.decode_at(messages.data, messages.start[rows])
    for row in strange:
        try:
            frame_id, message = _unusual(messages, row)
        except ValueError:
            if skip_unreadable:
                continue
            raise
        layout = layout_of(message, frame_id)
        array = np.zeros(1, layout.dtype)
        sec = min(message.stamp_ns // NANOSECONDS, _LAST_SEC)  # its ns may make a second or more
        array["sec"], array["nanosec"] = sec, message.stamp_ns - sec * NANOSECONDS
        for quantity in QUANTITIES:
            array[quantity] = getattr(message, quantity)
        yield np.array([row]), layout, array


def decode(messages: Messages) -> JointArrays:
    """Return one or more serialized messages as arrays, in bulk for each layout.

    Raises ValueError for bytes that are not JointState, and if values do not match names.
    """
    log = messages.log_time_ns
    parts = [(rows, _arrays(layout, array, log[rows])) for rows, layout, array in pieces(messages)]
    return parts[0][1] if isinstance(parts[0][0], slice) else _in_order(parts)


def _in_order(parts: Sequence[tuple[Rows, JointArrays]]) -> JointArrays:
    """Return messages in the order of their rows; names are in that of their first appearance."""
    numbered = [
        (np.arange(rows.start, rows.stop) if isinstance(rows, slice) else rows, part)
        for rows, part in parts
    ]
    numbered.sort(key=lambda part: int(part[0][0]))
    joined = concatenate([part for _, part in numbered])
    return joined.rows(np.argsort(np.concatenate([rows for rows, _ in numbered]), kind="stable"))


def _arrays(layout: JointStateLayout, array: NDArray[Any], log: Integers) -> JointArrays:
    """Return the messages that `JointStateLayout.decode_at` gives, which may be a view, as arrays."""
    check_counts(layout)
    # Contiguous copies: a view would keep the whole chunk alive.
    position, velocity, effort = (np.array(array[quantity], np.float64) for quantity in QUANTITIES)
    frames = (layout.frame_id,)
    return JointArrays(layout.name, stamps(array), log, position, velocity, effort, frames)


def sample(messages: Messages, row: int) -> JointSample:
    """Return a message that no layout describes. Raises ValueError if it cannot be read."""
    return _unusual(messages, row)[1]


def _unusual(messages: Messages, row: int) -> tuple[str, JointSample]:
    """Return the frame and the content of a message that no layout describes; raises as `sample`."""
    data = messages.data[messages.start[row] : messages.end[row]]
    try:
        layout = shared(JointStateLayout.parse(data))
        return layout.frame_id, layout.unpack(data)
    except ValueError as error:
        refused = error
    if len(data) > _MAX_UNUSUAL_BYTES:
        raise refused
    try:
        message = deserialize(JOINT_STATE_TYPE, data)
    except ValueError as error:  # the first reason is the better one, if it is one
        raise refused if data[:2] == b"\x00\x01" else error from None
    frame, names = message.header.frame_id, tuple(message.name)
    values = tuple(tuple(getattr(message, quantity).tolist()) for quantity in QUANTITIES)
    if len(names) > MAX_JOINTS or any(len(name) > MAX_NAME for name in (frame, *names)):
        raise refused
    position, velocity, effort = map(len, values)
    why = misfit(JointStateLayout(names, position, velocity, effort))
    if why:
        raise ValueError(why)
    return frame, JointSample(stamp_of(message.header.stamp), names, *values)


def concatenate(parts: Sequence[JointArrays]) -> JointArrays:
    """Return the parts concatenated; names that a part lacks are NaN there."""
    frames, frame = _all_frames(parts)
    names = tuple(dict.fromkeys(name for part in parts for name in part.names))
    places = {name: place for place, name in enumerate(names)}

    def spread(values: Floats, part: JointArrays) -> Floats:
        if part.names == names and values.shape[1]:
            return values
        wide = np.full((len(part), len(names)), np.nan)
        if values.shape[1]:
            wide[:, [places[name] for name in part.names]] = values
        return wide

    def joined(quantity: str) -> Floats:
        pairs = [(getattr(part, quantity), part) for part in parts]
        if not any(values.shape[1] for values, _ in pairs):
            return np.empty((sum(map(len, parts)), 0))
        return np.concatenate([spread(values, part) for values, part in pairs])

    no_stamps = np.empty(0, np.int64)
    stamp_ns = np.concatenate([no_stamps, *(part.stamp_ns for part in parts)])
    log_time_ns = np.concatenate([no_stamps, *(part.log_time_ns for part in parts)])
    position, velocity, effort = map(joined, QUANTITIES)
    return JointArrays(names, stamp_ns, log_time_ns, position, velocity, effort, frames, frame)


def _all_frames(parts: Sequence[JointArrays]) -> tuple[tuple[str, ...], Frames]:
    """Return all frames of the parts, and which of them each message has."""
    frames = tuple(dict.fromkeys(frame for part in parts for frame in part.frames)) or ("",)
    if len(frames) == 1:
        return frames, _ALL_OF_THE_FIRST
    places = {frame: place for place, frame in enumerate(frames)}
    tables = (np.array([places[frame] for frame in part.frames], np.int32) for part in parts)
    return frames, np.concatenate(
        [table[part.frame] for table, part in zip(tables, parts, strict=True)]
    )


def efforts_on(messages: Messages, joint: str) -> JointArrays:
    """Return a joint's efforts alone, from the messages that have one, whatever else they carry.

    These are the commands that a plant takes: the name is there once, with a finite effort.
    Raises LimitError.
    """
    parts: list[tuple[Rows, JointArrays]] = []
    for rows, layout, array in pieces(messages, skip_unreadable=True):
        names = layout.name
        place = names.index(joint) if names.count(joint) == 1 else layout.effort
        if place < layout.effort:
            effort = np.array(array["effort"][:, place : place + 1], np.float64)
            none = np.zeros((len(effort), 0))
            log = messages.log_time_ns[rows]
            frames = (layout.frame_id,)
            part = JointArrays((joint,), stamps(array), log, none, none, effort, frames)
            parts.append((rows, part))
    if not parts:
        none, no_stamps = np.zeros((0, 0)), np.zeros(0, np.int64)
        return JointArrays((joint,), no_stamps, no_stamps, none, none, np.zeros((0, 1)))
    joined = _in_order(parts)
    return joined.rows(np.flatnonzero(np.isfinite(joined.effort[:, 0])))
