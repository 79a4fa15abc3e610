"""`JointArrays`: a topic of JointState messages as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..samples import JointSample
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
QUANTITIES = ("position", "velocity", "effort")
_MAX_UNUSUAL_BYTES = 1 << 20  # of a message that is read one by one


@dataclass(frozen=True)
class JointArrays:
    """N messages in the order of the file.

    A quantity is [N, names], NaN where a message does not carry it, or [N, 0] if none does.
    """

    names: tuple[str, ...]
    stamp_ns: Integers  # [N], of the header
    log_time_ns: Integers  # [N], of the recording
    position: Floats
    velocity: Floats
    effort: Floats

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
        quantities = (getattr(self, quantity)[rows] for quantity in QUANTITIES)
        return JointArrays(self.names, self.stamp_ns[rows], self.log_time_ns[rows], *quantities)


def structured(messages: Messages) -> tuple[tuple[str, ...], NDArray[Any]] | None:
    """Return the names and an array of fields sec, nanosec, position, velocity, effort.

    No Python work per message; a quantity is [N, values]. None if the messages do not all
    share one layout, or are big-endian or malformed.
    """
    data, _, start, end = messages
    sizes = end - start
    if (sizes != sizes[0]).any():
        return None
    try:
        layout = shared(JointStateLayout.parse(data[start[0] : end[0]]))
        return layout.name, layout.decode_at(data, start)
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
    names = len(layout.name)
    if len(set(layout.name)) < names:
        return f"a name appears twice among {', '.join(layout.name)}"[:200]
    for quantity in QUANTITIES:
        count = getattr(layout, quantity)
        if count not in (0, names):
            return f"{count} values of {quantity} for {names} names"
    return ""


def decode(messages: Messages) -> JointArrays:
    """Return one or more serialized messages as arrays, in bulk for each layout.

    Raises ValueError for bytes that are not JointState, and if values do not match names.
    """
    log = messages.log_time_ns
    found = structured(messages)
    if found is not None:
        names, array = found
        return _arrays(names, stamps(array), log, [array[quantity] for quantity in QUANTITIES])
    parts: list[tuple[Integers, JointArrays]] = []
    regular, strange = groups(messages)
    for layout, rows in regular:
        array = layout.decode_at(messages.data, messages.start[rows])
        quantities = [array[quantity] for quantity in QUANTITIES]
        parts.append((rows, _arrays(layout.name, stamps(array), log[rows], quantities)))
    for row in strange:
        parts.append((np.array([row]), _one(sample(messages, row), log[row : row + 1])))
    parts.sort(key=lambda part: int(part[0][0]))
    joined = concatenate([part for _, part in parts])
    order = np.argsort(np.concatenate([rows for rows, _ in parts]), kind="stable")
    return joined.rows(order)


def _arrays(
    names: tuple[str, ...], stamp: Integers, log: Integers, quantities: Sequence[Any]
) -> JointArrays:
    for quantity, values in zip(QUANTITIES, quantities, strict=True):
        if values.shape[1] not in (0, len(names)):
            raise ValueError(f"{values.shape[1]} values of {quantity} for {len(names)} names")
    # Contiguous copies: a view would keep the whole chunk alive.
    return JointArrays(names, stamp, log, *(np.array(v, np.float64) for v in quantities))


def sample(messages: Messages, row: int) -> JointSample:
    """Return a message that no layout describes. Raises ValueError if it cannot be read."""
    data = messages.data[messages.start[row] : messages.end[row]]
    try:
        return shared(JointStateLayout.parse(data)).unpack(data)
    except ValueError as error:
        refused = error
    if len(data) > _MAX_UNUSUAL_BYTES:
        raise refused
    try:
        message = deserialize(JOINT_STATE_TYPE, data)
    except ValueError as error:  # the first reason is the better one, if it is one
        raise refused if data[:2] == b"\x00\x01" else error from None
    names = tuple(message.name)
    values = tuple(tuple(getattr(message, quantity).tolist()) for quantity in QUANTITIES)
    if len(names) > MAX_JOINTS or any(len(name) > MAX_NAME for name in names):
        raise refused
    position, velocity, effort = map(len, values)
    why = misfit(JointStateLayout(names, position, velocity, effort))
    if why:
        raise ValueError(why)
    return JointSample(stamp_of(message.header.stamp), names, *values)


def _one(found: JointSample, log: Integers) -> JointArrays:
    rows = [np.array([values], np.float64).reshape(1, -1) for values in found[2:]]
    return _arrays(found.name, np.array([found.stamp_ns], np.int64), log, rows)


def concatenate(parts: Sequence[JointArrays]) -> JointArrays:
    """Return the parts concatenated; names that a part lacks are NaN there."""
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
    return JointArrays(
        names,
        np.concatenate([no_stamps, *(part.stamp_ns for part in parts)]),
        np.concatenate([no_stamps, *(part.log_time_ns for part in parts)]),
        *(joined(quantity) for quantity in QUANTITIES),
    )
