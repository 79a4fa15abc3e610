"""`JointArrays`: a topic of JointState messages as NumPy arrays."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..samples import JointSample
from ..topics import JOINT_STATE_TYPE
from ..units import NANOSECONDS
from .joint_state_cdr import JointStateLayout, shared
from .schemas import deserialize, stamp_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .messages import Messages

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
QUANTITIES = ("position", "velocity", "effort")


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


def decode(messages: Messages) -> JointArrays:
    """Return one or more serialized messages as arrays, in bulk if they share a layout.

    Raises ValueError for bytes that are not JointState, and if values do not match names.
    """
    log = messages.log_time_ns
    found = structured(messages)
    if found is None:
        samples = [_sample(message) for message in messages.bytes()]
        return concatenate([_one(s, log[i : i + 1]) for i, s in enumerate(samples)])
    names, array = found
    return _arrays(names, stamps(array), log, [array[quantity] for quantity in QUANTITIES])


def _arrays(
    names: tuple[str, ...], stamp: Integers, log: Integers, quantities: Sequence[Any]
) -> JointArrays:
    for quantity, values in zip(QUANTITIES, quantities, strict=True):
        if values.shape[1] not in (0, len(names)):
            raise ValueError(f"{values.shape[1]} values of {quantity} for {len(names)} names")
    # Contiguous copies: a view would keep the whole chunk alive.
    return JointArrays(names, stamp, log, *(np.array(v, np.float64) for v in quantities))


def _sample(data: bytes) -> JointSample:
    with suppress(ValueError):
        return shared(JointStateLayout.parse(data)).unpack(data)
    message = deserialize(JOINT_STATE_TYPE, data)
    values = (tuple(getattr(message, quantity).tolist()) for quantity in QUANTITIES)
    return JointSample(stamp_of(message.header.stamp), tuple(message.name), *values)


def _one(sample: JointSample, log: Integers) -> JointArrays:
    rows = [np.array([values], np.float64).reshape(1, -1) for values in sample[2:]]
    return _arrays(sample.name, np.array([sample.stamp_ns], np.int64), log, rows)


def concatenate(parts: Sequence[JointArrays]) -> JointArrays:
    """Return the parts concatenated; names that a part lacks are NaN there."""
    names = tuple(dict.fromkeys(name for part in parts for name in part.names))

    def spread(values: Floats, part: JointArrays) -> Floats:
        if part.names == names and values.shape[1]:
            return values
        wide = np.full((len(part), len(names)), np.nan)
        if values.shape[1]:
            wide[:, [names.index(name) for name in part.names]] = values
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
