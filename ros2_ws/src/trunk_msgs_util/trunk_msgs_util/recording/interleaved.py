"""Many messages of several topics as the records of an MCAP file, in their order, made in bulk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from .messages import HEAD, HEAD_FIELDS, unaligned

if TYPE_CHECKING:
    from .joint_table import Integers


class Rows(NamedTuple):
    """N messages of one channel that are equally long, in their order."""

    channel: int
    place: Integers  # [N], ascending: where among the messages of all channels
    time_ns: Integers  # [N], log and publish time, not negative
    data: NDArray[Any]  # [N], one element is one message


class Interleaved(NamedTuple):
    """M message records, one after the other; record i is ``data[start[i]:end[i]]``."""

    data: NDArray[np.uint8]
    start: Integers
    end: Integers
    channel: Integers
    time_ns: Integers

    def records(self, first: int, last: int) -> bytes:
        """Return the records in [first, last)."""
        return self.data[self.start[first] : self.end[last - 1]].tobytes()

    def heads(self, first: int, last: int) -> bytes:
        """Return the header of each message's data in the records in [first, last)."""
        return self._pieces(self.start[first:last], HEAD_FIELDS.itemsize)

    def messages(self, rows: Integers) -> bytes:
        """Return the messages of some records without their heads."""
        start, end = self.start[rows] + HEAD_FIELDS.itemsize, self.end[rows]
        size = int(end[0] - start[0])
        if (end - start == size).all():
            return self._pieces(start, size)
        spans = zip(start.tolist(), end.tolist(), strict=True)
        return b"".join([self.data[a:b].tobytes() for a, b in spans])

    def _pieces(self, start: Integers, size: int) -> bytes:
        return unaligned(self.data, f"V{size}")[start].tobytes()


def interleaved(rows: Sequence[Rows], counts: dict[int, int]) -> Interleaved:
    """Return the records of all rows by their place; of equal places the first in ``rows`` comes first.

    ``counts`` are the channels' next sequence numbers, and go on. Rows of the same channel follow
    one another.
    """
    rows = sorted(rows, key=lambda part: int(part.place[0]))  # as new channels enter ``counts``
    lengths = [len(part.place) for part in rows]
    sizes = np.repeat([HEAD_FIELDS.itemsize + part.data.itemsize for part in rows], lengths)
    order = np.argsort(np.concatenate([part.place for part in rows]), kind="stable")
    end = np.cumsum(sizes[order])
    start = end - sizes[order]
    data = np.empty(int(end[-1]), np.uint8)
    at = np.empty_like(start)
    at[order] = start
    first = 0
    for part, length in zip(rows, lengths, strict=True):
        records = _records(part, counts.get(part.channel, 0))
        counts[part.channel] = counts.get(part.channel, 0) + length
        unaligned(data, records.dtype)[at[first : first + length]] = records
        first += length
    channel = np.repeat([part.channel for part in rows], lengths)
    time_ns = np.concatenate([part.time_ns for part in rows])
    return Interleaved(data, start, end, channel[order], time_ns[order])


def _records(rows: Rows, sequence: int) -> NDArray[np.void]:
    size = rows.data.itemsize
    records = np.empty(len(rows.place), [("head", HEAD_FIELDS), ("data", f"V{size}")])
    head = records["head"]
    head["opcode"] = Opcode.MESSAGE
    head["length"] = HEAD_FIELDS.itemsize - HEAD.size + size
    head["channel"] = rows.channel
    head["sequence"] = np.arange(sequence, sequence + len(records))
    head["log_time"] = head["publish_time"] = rows.time_ns
    records["data"] = rows.data.view(f"V{size}")
    return records.view(f"V{records.itemsize}")
