"""Chosen columns of JointState topics, read in one pass with little more memory than they take."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .file import RecordingError
from .joint_arrays import QUANTITIES, Floats, Integers, decode, stamps, structured

if TYPE_CHECKING:
    from .reader import Recording
    from .split import ChunkMessages

Column = tuple[str, str]  # quantity, name


@dataclass(frozen=True)
class Series:
    """Some columns [N] of a topic by rising stamps, the first of those with the same one."""

    stamp_ns: Integers
    columns: Mapping[Column, Floats]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def column(self, quantity: str, name: str) -> Floats:
        """Return a column that was asked for; NaN where a message did not carry it."""
        return self.columns[quantity, name]


def read_series(
    recording: Recording, wanted: Mapping[str, Collection[Column]]
) -> dict[str, Series]:
    """Return columns of some topics (absolute names), empty ones for unknown topics.

    Raises RecordingError where a topic has other messages than JointState.
    """
    series = {
        topic: _Filling(recording.topics[topic].count if topic in recording.topics else 0, columns)
        for topic, columns in wanted.items()
    }
    for block in recording.blocks(wanted):
        for topic, messages in block.items():
            try:
                series[topic].take(messages)
            except (ValueError, OverflowError) as error:
                raise RecordingError(
                    f"{recording.path}: {topic} cannot be read as JointState: {error}"
                ) from None
    return {topic: series.pop(topic).ordered() for topic in list(series)}


def in_turn(series: Sequence[Series]) -> Series:
    """Return what several topics with the same columns say, as one by rising stamps."""
    if len(series) == 1:
        return series[0]
    stamp_ns, rows = np.unique(np.concatenate([s.stamp_ns for s in series]), return_index=True)
    return Series(
        stamp_ns,
        {
            column: np.concatenate([s.columns[column] for s in series])[rows]
            for column in series[0].columns
        },
    )


def joint_names(recording: Recording, topic: str) -> tuple[str, ...]:
    """Return the names in a topic's first message; none without messages."""
    for block in recording.blocks([topic]):
        try:
            return decode(block[topic].first()).names
        except (ValueError, OverflowError) as error:
            raise RecordingError(
                f"{recording.path}: {topic} cannot be read as JointState: {error}"
            ) from None
    return ()


class _Filling:
    """Columns made at their full length, filled block by block."""

    def __init__(self, count: int, columns: Iterable[Column]) -> None:
        self._at = 0
        self._stamp_ns: Integers = np.empty(count, np.int64)
        self._columns: dict[Column, Floats] = {column: np.empty(count) for column in columns}

    def take(self, messages: ChunkMessages) -> None:
        rows = slice(self._at, self._at + len(messages))
        self._at = rows.stop
        found = structured(messages)
        if found is None:
            arrays = decode(messages)
            self._stamp_ns[rows] = arrays.stamp_ns
            for (quantity, name), values in self._columns.items():
                values[rows] = arrays.column(quantity, name)
            return
        names, array = found
        for quantity in QUANTITIES:
            if array[quantity].shape[1] not in (0, len(names)):
                raise ValueError(
                    f"{array[quantity].shape[1]} values of {quantity} for {len(names)} names"
                )
        self._stamp_ns[rows] = stamps(array)
        for (quantity, name), values in self._columns.items():
            has = name in names and array[quantity].shape[1]
            values[rows] = array[quantity][:, names.index(name)] if has else np.nan

    def ordered(self) -> Series:
        """Return what was filled; nothing is copied where the stamps rise."""
        if (self._stamp_ns[1:] > self._stamp_ns[:-1]).all():
            return Series(self._stamp_ns, self._columns)
        _, rows = np.unique(self._stamp_ns, return_index=True)
        columns = {column: values[rows] for column, values in self._columns.items()}
        return Series(self._stamp_ns[rows], columns)
