"""Chosen columns of JointState topics, read in one pass with little memory beyond their own."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..topics import JOINT_STATE_TYPE
from .joint_arrays import Floats, Integers, JointArrays, check_counts, decode, stamps, structured
from .topic import RecordingError

if TYPE_CHECKING:
    from .messages import Messages
    from .reader import Recording

Column = tuple[str, str]  # quantity, name


@dataclass(frozen=True)
class Series:
    """Some columns [N] of a topic by increasing stamp, the first of those with equal stamps."""

    stamp_ns: Integers
    columns: Mapping[Column, Floats]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def column(self, quantity: str, name: str) -> Floats:
        """Return a requested column; NaN where a message did not carry it."""
        return self.columns[quantity, name]


def read_series(
    recording: Recording, wanted: Mapping[str, Collection[Column]]
) -> dict[str, Series]:
    """Return columns of some topics (absolute names), empty ones for unknown topics.

    Messages that cannot be read are left out. Raises RecordingError if a topic is of another type,
    or has not as many messages as were counted when the recording was opened.
    """
    for topic in wanted:
        recording.check_type(topic, JOINT_STATE_TYPE)
    series = {
        topic: _Filling(
            recording.topics[topic].readable if topic in recording.topics else 0, columns
        )
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
    for topic, filling in series.items():
        if filling.found != filling.count:
            raise RecordingError(
                f"{recording.path}: {topic} has {filling.found} messages, {filling.count} were "
                "counted: its index is wrong (trunk doctor) or the file has changed: open it again"
            )
    return {topic: series.pop(topic).ordered() for topic in list(series)}


def series_of(arrays: JointArrays, columns: Collection[Column]) -> Series:
    """Return columns of a topic that was read whole."""
    rows = arrays.by_stamp()
    return Series(rows.stamp_ns, {column: rows.column(*column) for column in columns})


def in_turn(series: Sequence[Series]) -> Series:
    """Return several topics with the same columns merged into one, by increasing stamp."""
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
    """Return the names in a topic's first readable message; none without messages."""
    recording.check_type(topic, JOINT_STATE_TYPE)
    for block in recording.blocks([topic]):
        try:
            return decode(block[topic].first()).names
        except (ValueError, OverflowError) as error:
            raise RecordingError(
                f"{recording.path}: {topic} cannot be read as JointState: {error}"
            ) from None
    return ()


class _Filling:
    """Columns allocated at full length and filled block by block."""

    def __init__(self, count: int, columns: Iterable[Column]) -> None:
        self.count = count
        self.found = 0
        self._stamp_ns: Integers = np.empty(count, np.int64)
        self._columns: dict[Column, Floats] = {column: np.empty(count) for column in columns}

    def take(self, messages: Messages) -> None:
        rows = slice(self.found, self.found + len(messages))
        self.found = rows.stop
        if self.found > self.count:
            return  # `read_series` says so
        found = structured(messages)
        if found is None:
            arrays = decode(messages)
            self._stamp_ns[rows] = arrays.stamp_ns
            for (quantity, name), values in self._columns.items():
                values[rows] = arrays.column(quantity, name)
            return
        layout, array = found
        names = layout.name
        check_counts(layout)
        self._stamp_ns[rows] = stamps(array)
        for (quantity, name), values in self._columns.items():
            has = name in names and array[quantity].shape[1]
            values[rows] = array[quantity][:, names.index(name)] if has else np.nan

    def ordered(self) -> Series:
        """Return what was filled, without a copy if the stamps increase."""
        if (self._stamp_ns[1:] > self._stamp_ns[:-1]).all():
            return Series(self._stamp_ns, self._columns)
        _, rows = np.unique(self._stamp_ns, return_index=True)
        columns = {column: values[rows] for column, values in self._columns.items()}
        return Series(self._stamp_ns[rows], columns)
