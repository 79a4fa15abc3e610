"""`JointArrays`: a topic of JointState messages as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..samples import JointSample, has_doubled
from ..topics import JOINT_STATE_TYPE
from ..units import NANOSECONDS
from .joint_state_cdr import JointStateLayout, shared
from .limits import MAX_JOINTS, MAX_LAYOUTS, MAX_NAME, LimitError
from .schemas import deserialize, stamp_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .messages import Messages

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Frames = NDArray[np.int32]
QUANTITIES = ("position", "velocity", "effort")
_MAX_UNUSUAL_BYTES = 1 << 20  # of a message that is read one by one
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
    found: list[tuple[JointStateLayout, Integers]] = []
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
            found.append((layout, left[fits]))
            left = left[~fits]
            if len(found) > MAX_LAYOUTS:
                raise LimitError(f"its messages have more than {MAX_LAYOUTS} layouts")
    return sorted(found, key=lambda one: int(one[1][0])), sorted(strange)


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


def decode(messages: Messages) -> JointArrays:
    """Return one or more serialized messages as arrays, in bulk for each layout.

    Raises ValueError for bytes that are not JointState, and if values do not match names.
    """
    log = messages.log_time_ns
    found = structured(messages)
    if found is not None:
        layout, array = found
        return _arrays(layout, array, log)
    parts: list[tuple[Integers, JointArrays]] = []
    regular, strange = groups(messages)
    for layout, rows in regular:
        array = layout.decode_at(messages.data, messages.start[rows])
        parts.append((rows, _arrays(layout, array, log[rows])))
    for row in strange:
        parts.append((np.array([row]), _one(messages, row)))
    parts.sort(key=lambda part: int(part[0][0]))
    joined = concatenate([part for _, part in parts])
    order = np.argsort(np.concatenate([rows for rows, _ in parts]), kind="stable")
    return joined.rows(order)


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


def _one(messages: Messages, row: int) -> JointArrays:
    frame, (stamp_ns, names, *quantities) = _unusual(messages, row)
    stamp, log = np.array([stamp_ns], np.int64), messages.log_time_ns[row : row + 1]
    position, velocity, effort = (np.array([v], np.float64).reshape(1, -1) for v in quantities)
    return JointArrays(names, stamp, log, position, velocity, effort, (frame,))


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
    parts: list[tuple[Integers, JointArrays]] = []
    regular, strange = groups(messages)
    for layout, rows in regular:
        place = _place_of_effort(layout.name, layout.effort, joint)
        if place is not None:
            array = layout.decode_at(messages.data, messages.start[rows])
            effort = np.array(array["effort"][:, place : place + 1], np.float64)
            parts.append((rows, _of_joint(joint, stamps(array), effort, layout.frame_id)))
    for row in strange:
        try:
            frame_id, sample = _unusual(messages, row)
        except ValueError:
            continue
        place = _place_of_effort(sample.name, len(sample.effort), joint)
        if place is not None:
            stamp_ns = np.array([sample.stamp_ns])
            effort = np.array([[sample.effort[place]]])
            parts.append((np.array([row]), _of_joint(joint, stamp_ns, effort, frame_id)))
    if not parts:
        return _of_joint(joint, np.zeros(0, np.int64), np.zeros((0, 1)), "")
    rows = np.concatenate([rows for rows, _ in parts])
    joined = concatenate([part for _, part in parts])
    joined = replace(joined, log_time_ns=messages.log_time_ns[rows])
    order = np.argsort(rows, kind="stable")
    return joined.rows(order[np.isfinite(joined.effort[order, 0])])


def _place_of_effort(names: Sequence[str], count: int, joint: str) -> int | None:
    place = names.index(joint) if names.count(joint) == 1 else count
    return place if place < count else None


def _of_joint(joint: str, stamp_ns: Integers, effort: Floats, frame_id: str) -> JointArrays:
    nothing = np.zeros((len(stamp_ns), 0))
    return JointArrays((joint,), stamp_ns, stamp_ns, nothing, nothing, effort, (frame_id,))
