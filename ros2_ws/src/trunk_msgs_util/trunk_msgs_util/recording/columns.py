"""Columns of JointState topics, read in one pass with little memory beyond their own."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..topics import JOINT_STATE_TYPE
from .joint_arrays import (
    QUANTITIES,
    Floats,
    Frames,
    Integers,
    JointArrays,
    Rows,
    all_of_the_first,
    check_counts,
    decode,
    pieces,
    stamps,
)
from .limits import MAX_LAYOUTS
from .topic import RecordingError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .joint_state_cdr import JointStateLayout
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
    loaders = {
        topic: _SeriesLoader(
            recording.topics[topic].readable if topic in recording.topics else 0, columns
        )
        for topic, columns in wanted.items()
    }
    for block in recording.blocks(wanted):
        for topic, messages in block.items():
            try:
                loaders[topic].take(messages)
            except (ValueError, OverflowError) as error:
                raise RecordingError(
                    f"{recording.path}: {topic} cannot be read as JointState: {error}"
                ) from None
    for topic, loader in loaders.items():
        if loader.loaded != loader.count:
            raise RecordingError(
                f"{recording.path}: {topic} has {loader.loaded} messages, {loader.count} were "
                "counted: its index is wrong (trunk doctor) or the file has changed: open it again"
            )
    series: dict[str, Series] = {}
    for topic in list(loaders):
        ordered = loaders.pop(topic).ordered()
        for (
            other
        ) in series.values():  # answers have the stamps of what they answer: they share memory
            if np.array_equal(other.stamp_ns, ordered.stamp_ns):
                ordered = Series(other.stamp_ns, ordered.columns)
                break
        series[topic] = ordered
    return series


def series_of(arrays: JointArrays, columns: Collection[Column]) -> Series:
    """Return columns of a topic that was read whole."""
    rows = arrays.by_stamp()
    return Series(rows.stamp_ns, {column: rows.column(*column) for column in columns})


def in_turn(series: Sequence[Series]) -> Series:
    """Return the columns that several topics share, merged into one by increasing stamp."""
    if len(series) == 1:
        return series[0]
    stamp_ns, rows = np.unique(np.concatenate([s.stamp_ns for s in series]), return_index=True)
    return Series(
        stamp_ns,
        {
            column: np.concatenate([s.columns[column] for s in series])[rows]
            for column in series[0].columns
            if all(column in s.columns for s in series)
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


class _TopicLoader:
    """Takes a topic's messages in their order, into arrays of full length."""

    def __init__(self, count: int) -> None:
        self.count = count  # of messages, expected
        self.loaded = 0
        self._stamp_ns: Integers = np.empty(count, np.int64)

    def take(self, messages: Messages) -> None:
        """Take the next messages; ones beyond ``count`` are only counted. Raises ValueError."""
        first, self.loaded = self.loaded, self.loaded + len(messages)
        if self.loaded > self.count:
            return
        for rows, layout, array in pieces(messages):
            if isinstance(rows, slice):
                self._put(slice(first, self.loaded), layout, array)
            else:
                self._put(first + rows, layout, array)

    def _put(self, rows: Rows, layout: JointStateLayout, array: NDArray[Any]) -> None:
        """Put messages of one layout, as `JointStateLayout.decode_at` gives them, into these rows."""
        self._stamp_ns[rows] = stamps(array)


class _SeriesLoader(_TopicLoader):
    """Loads some columns, whatever else a message carries."""

    def __init__(self, count: int, columns: Iterable[Column]) -> None:
        super().__init__(count)
        self._columns: dict[Column, Floats] = {column: np.empty(count) for column in columns}

    def _put(self, rows: Rows, layout: JointStateLayout, array: NDArray[Any]) -> None:
        check_counts(layout)
        super()._put(rows, layout, array)
        for (quantity, name), values in self._columns.items():
            has = name in layout.name and array[quantity].shape[1]
            values[rows] = array[quantity][:, layout.name.index(name)] if has else np.nan

    def ordered(self) -> Series:
        """Return the columns, without a copy if the stamps increase."""
        if (self._stamp_ns[1:] > self._stamp_ns[:-1]).all():
            return Series(self._stamp_ns, self._columns)
        _, rows = np.unique(self._stamp_ns, return_index=True)
        columns = {column: values[rows] for column, values in self._columns.items()}
        return Series(self._stamp_ns[rows], columns)


class ColumnLoader(_TopicLoader):
    """Loads all columns of a topic whose messages all have the same names and quantities.

    Their frames may differ, as where another controller takes over.
    """

    def __init__(self, count: int, values: bool) -> None:
        """Expect ``count`` messages; without ``values``, only their stamps and what is in each are kept."""
        super().__init__(count)
        self.names: tuple[str, ...] = ()
        self.widths: dict[str, int] = {}
        self._regular = True
        self._values: dict[str, Floats] | None = {} if values else None
        self._log_time_ns: Integers = np.empty(count, np.int64)
        self._frames: dict[str, int] = {}
        self._frame: Frames | None = None  # made where there is more than one frame

    def take(self, messages: Messages) -> None:
        """Take the next messages, unless some before them were irregular."""
        if not self._regular:
            return
        rows = slice(self.loaded, self.loaded + len(messages))
        try:
            super().take(messages)
        except ValueError:
            self._regular = False
        else:
            if self.loaded <= self.count:
                self._log_time_ns[rows] = messages.log_time_ns

    def _put(self, rows: Rows, layout: JointStateLayout, array: NDArray[Any]) -> None:
        widths = {quantity: int(getattr(layout, quantity)) for quantity in QUANTITIES}
        if not self.widths:
            self._begin(layout.name, widths)
        place = self._frames.setdefault(layout.frame_id, len(self._frames))
        if (layout.name, widths) != (self.names, self.widths) or place >= MAX_LAYOUTS:
            self._regular = False
        if not self._regular:
            return
        if place and self._frame is None:
            self._frame = np.zeros(self.count, np.int32)
        if self._frame is not None:
            self._frame[rows] = place
        super()._put(rows, layout, array)
        for quantity, values in (self._values or {}).items():
            values[rows] = array[quantity]

    def _begin(self, names: tuple[str, ...], widths: dict[str, int]) -> None:
        self.names, self.widths = names, widths
        self._regular = all(width in (0, len(names)) for width in widths.values())
        if self._values is not None:
            self._values = {q: np.empty((self.count, width)) for q, width in widths.items()}

    @property
    def whole(self) -> bool:
        """True if the topic is regular, and as many messages came as were expected."""
        return self._regular and 0 < self.loaded == self.count

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
        return all_of_the_first(self.count) if self._frame is None else self._frame

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
