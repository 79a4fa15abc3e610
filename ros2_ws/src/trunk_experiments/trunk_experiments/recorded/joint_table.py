"""`JointTable`: a JointState topic whose rows are found by stamp."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import cached_property

import numpy as np

from trunk_msgs_util.recording.columns import Column, ColumnLoader
from trunk_msgs_util.recording.joint_arrays import (
    QUANTITIES,
    Floats,
    Frames,
    Integers,
    JointArrays,
    concatenate,
    decode,
    efforts_on,
)
from trunk_msgs_util.recording.limits import LimitError
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.topics import JOINT_STATE_TYPE
from trunk_msgs_util.units import seconds

_LARGE = 1 << 17  # rows: from here on a dictionary of them takes too much memory


class JointTable:
    """A JointState topic whose rows are found by stamp; of equal stamps the first row counts.

    ``needed``: messages in which one of these columns is not finite are left out, as a controller skips them.
    ``joint``: only its efforts, from the messages that have one: the commands that a plant takes.
    ``filled``: what was already read of it; its values, where they were not kept, are read when asked for.
    """

    frames: tuple[str, ...]
    frame: Frames  # [N], of each message: an index into `frames`

    def __init__(
        self,
        recording: Recording,
        relative: str,
        needed: Collection[Column] = (),
        filled: ColumnLoader | None = None,
        known_ns: Integers | None = None,
        joint: str | None = None,
    ) -> None:
        """Stamps that equal ``known_ns`` share its memory."""
        self.topic = relative
        self._recording = recording
        self._joint = joint
        self._where = f"{recording.path}: {recording.topic(relative)}"
        if filled is None:
            self.arrays = self._read(needed)
            self.names, self.stamp_ns = self.arrays.names, self.arrays.stamp_ns
            self.log_time_ns = self.arrays.log_time_ns
            self.frames, self.frame = self.arrays.frames, self.arrays.frame
            self.widths = {q: getattr(self.arrays, q).shape[1] for q in QUANTITIES}
        else:
            self.names, self.widths = filled.names, filled.widths
            self.frames, self.frame = filled.frames, filled.frame
            self.stamp_ns, self.log_time_ns = filled.times(known_ns)
            arrays = filled.arrays(self.stamp_ns, self.log_time_ns)
            if arrays is not None:
                self.arrays = arrays
        self._window: tuple[int, Floats] = 0, np.empty((0, 0))
        self._coming: Iterator[Floats] | None = None

    def _read(self, needed: Collection[Column] = ()) -> JointArrays:
        if self._joint is not None:
            return self._read_efforts(self._joint)
        arrays = self._recording.joints(self._recording.topic(self.topic))
        if needed:
            columns = np.column_stack([arrays.column(*column) for column in needed])
            arrays = arrays.rows(np.flatnonzero(np.isfinite(columns).all(axis=1)))
        return arrays

    def _read_efforts(self, joint: str) -> JointArrays:
        topic = self._recording.topic(self.topic)
        self._recording.check_type(topic, JOINT_STATE_TYPE)
        blocks = self._recording.blocks([topic])
        try:
            return concatenate(
                [efforts_on(block[topic], joint) for block in blocks if topic in block]
            )
        except LimitError as error:
            raise RecordingError(f"{self._where}: {error}") from None

    @cached_property
    def arrays(self) -> JointArrays:
        """All messages."""
        return self._read()

    @cached_property
    def stamps(self) -> list[int]:
        """All stamps in file order, ns."""
        return [int(stamp) for stamp in self.stamp_ns.tolist()]

    @cached_property
    def rows(self) -> Mapping[int, int]:
        """Each stamp's row."""
        rows: dict[int, int] = {}
        for row, stamp in enumerate(self.stamps):
            rows.setdefault(stamp, row)
        return rows

    @cached_property
    def _ascends(self) -> bool:
        return bool((self.stamp_ns[1:] > self.stamp_ns[:-1]).all())

    def row(self, stamp_ns: int) -> int | None:
        """Return the first row with a stamp; None if there is none."""
        if len(self) < _LARGE or not self._ascends:
            return self.rows.get(stamp_ns)
        row = int(np.searchsorted(self.stamp_ns, stamp_ns))
        return row if row < len(self) and self.stamp_ns[row] == stamp_ns else None

    def __contains__(self, stamp_ns: int) -> bool:
        return self.row(stamp_ns) is not None

    def __len__(self) -> int:
        return len(self.stamp_ns)

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
                f"{self._where}: {len(values)} values of {quantity} for {len(self.names)} names at "
                f"t = {seconds(stamp_ns):g} s, {needed} are needed: it cannot be recomputed"
            )
        return values

    def index(self, joint: str) -> int:
        """Return the index of a joint's values. Raises RecordingError if there is none."""
        if joint not in self.names:
            if reason := self._recording.unreadable(self._recording.topic(self.topic)):
                raise RecordingError(f"{self._where}: {reason}")
            there = f"only {', '.join(self.names)}" if len(self) else "and no messages"
            raise RecordingError(
                f"{self._where} has no joint {joint!r}, {there}: it cannot be recomputed"
            )
        return self.names.index(joint)

    def values(self, quantity: str) -> Floats:
        """Return all values of a quantity [N, names], or [N, 0] if no message carries it."""
        values: Floats = getattr(self.arrays, quantity)
        return values

    def columns(self, quantity: str, count: int) -> Floats:
        """Return all values of a quantity [N, count]. Raises RecordingError as `check_columns`."""
        self.check_columns(quantity, count)
        return self.values(quantity)

    def check_columns(self, quantity: str, count: int) -> None:
        """Raise RecordingError unless messages have this many names, and a value of the quantity for each."""
        width = self.widths[quantity]
        if not width == len(self.names) == count:
            raise RecordingError(
                f"{self._where}: {width} values of {quantity} for {len(self.names)} names, "
                f"{count} are needed: it cannot be recomputed"
            )

    def rows_of(self, stamps: Integers, among: Integers | None = None) -> Integers:
        """Return the row of each stamp, of all rows or ``among`` some; -1 if there is none."""
        known = self.stamp_ns if among is None else self.stamp_ns[among]
        if not len(known):
            return np.full(len(stamps), -1)
        if among is not None or not self._ascends:
            order = np.argsort(known, kind="stable")
            known, among = known[order], order if among is None else among[order]
        at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
        return np.where(known[at] == stamps, at if among is None else among[at], -1)

    def positions(self, first: int, stop: int) -> Floats:
        """Return the positions [stop - first, names] of some rows.

        Values that were not kept are read again, block by block: fastest in ascending order.
        """
        if "arrays" in self.__dict__:
            return self.values("position")[first:stop]
        begin, held = self._window
        if self._coming is None or first < begin:
            begin, held, self._coming = 0, np.empty((0, len(self.names))), self._in_passing()
        parts, end = [held], begin + len(held)
        while end < stop:
            part = next(self._coming, None)
            if part is None:
                raise RecordingError(f"{self._where}: the file has changed: open it again")
            parts.append(part)
            end += len(part)
            while begin + len(parts[0]) <= first and len(parts) > 1:
                begin += len(parts.pop(0))
        held = np.concatenate(parts)[first - begin :]
        self._window = first, held
        return held[: stop - first]

    def _in_passing(self) -> Iterator[Floats]:
        topic = self._recording.topic(self.topic)
        for block in self._recording.blocks([topic]):
            yield decode(block[topic]).position
