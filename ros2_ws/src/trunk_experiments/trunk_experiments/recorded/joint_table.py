"""`JointTable`: a JointState topic whose rows are found by stamp."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property

import numpy as np

from trunk_msgs_util.recording.joint_arrays import QUANTITIES, Floats, Integers
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.recording.series import Column
from trunk_msgs_util.units import seconds


class JointTable:
    """A JointState topic whose rows are found by stamp; of equal stamps the first row counts.

    ``needed``: messages in which one of these columns is not finite are left out, as a controller skips them.
    """

    def __init__(
        self, recording: Recording, relative: str, needed: Collection[Column] = ()
    ) -> None:
        self.topic = relative
        self._where = f"{recording.path}: {recording.topic(relative)}"
        self.arrays = recording.joints(recording.topic(relative))
        if needed:
            columns = np.column_stack([self.arrays.column(*column) for column in needed])
            self.arrays = self.arrays.rows(np.flatnonzero(np.isfinite(columns).all(axis=1)))
        self.names = self.arrays.names
        self.stamp_ns: Integers = self.arrays.stamp_ns
        self._values: dict[str, Floats] = {
            quantity: getattr(self.arrays, quantity) for quantity in QUANTITIES
        }

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

    def __contains__(self, stamp_ns: int) -> bool:
        return stamp_ns in self.rows

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def get(self, stamp_ns: int, quantity: str, count: int | None = None) -> list[float]:
        """Return a message's values of a quantity, one for each name; KeyError without the stamp.

        Raises RecordingError if they are not as many as the names, or as ``count``.
        """
        values: list[float] = self._values[quantity][self.rows[stamp_ns]].tolist()
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
            there = f"only {', '.join(self.names)}" if len(self) else "and no messages"
            raise RecordingError(
                f"{self._where} has no joint {joint!r}, {there}: it cannot be recomputed"
            )
        return self.names.index(joint)

    def values(self, quantity: str) -> Floats:
        """Return all values of a quantity [N, names], or [N, 0] if no message carries it."""
        return self._values[quantity]

    def rows_of(self, stamps: Integers) -> Integers:
        """Return the row of each stamp, -1 if there is none."""
        order = np.argsort(self.stamp_ns, kind="stable")
        known = self.stamp_ns[order]
        if not len(known):
            return np.full(len(stamps), -1)
        at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
        return np.where(known[at] == stamps, order[at], -1)
