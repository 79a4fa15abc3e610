"""The fields of a sensor_msgs/JointState message in XCDR1, laid out or read one by one: each aligned."""

from __future__ import annotations

import struct

from .limits import MAX_NAME

CDR = b"\x00\x01"  # little-endian; two bytes of options follow
ORIGIN = 4  # alignment counts from here


class FieldPlan:
    """The struct format of a layout, written field by field, and its constant pieces."""

    def __init__(self) -> None:
        # The two option bytes of the encapsulation header may hold anything; zeros are written.
        self.format = [f"<{len(CDR)}s{ORIGIN - len(CDR)}x", "iI"]
        self.at = 8  # from the origin, after the stamp
        self.pieces: list[list[bytes]] = [[]]  # what precedes each group of doubles
        self.piece_offsets: list[int] = []
        self.double_offsets: list[int] = []

    def align(self, size: int) -> None:
        padding = -self.at % size
        if padding:
            self.format.append(f"{padding}x")
        self.at += padding

    def constant(self, data: bytes) -> None:
        group = self.pieces[-1]
        if group and self.format[-1].endswith("s"):  # one piece with what is right before it
            group[-1] += data
            self.format[-1] = f"{len(group[-1])}s"
        else:
            group.append(data)
            self.format.append(f"{len(data)}s")
            self.piece_offsets.append(ORIGIN + self.at)
        self.at += len(data)

    def count(self, value: int) -> None:
        self.align(4)
        self.constant(struct.pack("<I", value))

    def string(self, text: str) -> None:
        data = text.encode() + b"\x00"
        self.count(len(data))
        self.constant(data)

    def doubles(self, count: int) -> None:
        self.count(count)
        if count:  # an empty sequence is not aligned
            self.align(8)
            self.format.append(f"{count}d")
        self.double_offsets.append(ORIGIN + self.at)
        self.pieces.append([])
        self.at += 8 * count


class FieldCursor:
    """Reads the parts of a message that determine its layout, never past its end."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = ORIGIN

    def take(self, size: int, alignment: int) -> bytes:
        start = self.at + (ORIGIN - self.at) % alignment
        self.at = start + size
        if self.at > len(self.data):
            raise ValueError(f"a message of {len(self.data)} bytes ends before byte {self.at}")
        return self.data[start : self.at]

    def count(self) -> int:
        return int.from_bytes(self.take(4, 4), "little")

    def string(self) -> str:
        data = self.take(self.count(), 1)
        if data[-1:] != b"\x00":
            raise ValueError("a string without its terminator")
        if len(data) > MAX_NAME + 1:
            raise ValueError(f"a name of {len(data) - 1} bytes, at most {MAX_NAME} are read")
        return data[:-1].decode()

    def strings(self, limit: int) -> tuple[str, ...]:
        count = self.count()
        if count > limit:
            self.take(4 * count, 4)  # no more than can be there
            raise ValueError(f"{count} names, at most {limit} are read")
        return tuple(self.string() for _ in range(count))

    def doubles(self) -> int:
        count = self.count()
        if count:
            self.take(8 * count, 8)
        return count
