"""XCDR1, little-endian: messages read and written by a table of their fields, each aligned to its size.

rosbags compiles its code for a type anew in each process, which takes longer than reading a ten-second
recording. What is not exactly as ROS 2 writes it is refused here, and left to rosbags.

Most messages of a run are sensor_msgs/JointState messages whose layout stays the same. A layout (frame,
names, number of values) fixes every byte of a message except its stamp and values: one precomputed struct
packs it, and one NumPy type reads thousands of joined messages at once. Bytes are those of Fast CDR and of
rosbags. Padding is written as zeros and ignored when read: Fast CDR leaves old buffer content in it.
Big-endian messages are not read here.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from trunk_core.samples import JointSample
from trunk_core.units import LAST_STAMP_NS, NANOSECONDS

if TYPE_CHECKING:
    from numpy.typing import NDArray

CDR = b"\x00\x01"  # little-endian; two bytes of options follow
ORIGIN = 4  # alignment counts from here
MAX_NAME = 1024  # bytes of the name of a joint or a frame
_HEAD = CDR.ljust(ORIGIN, b"\x00")

# A type: the name of a number or "string", the fields of a structure, or a sequence of one type.
Type: TypeAlias = str | tuple["Type", ...] | list["Type"]

_CODES = {"bool": "B", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "float64": "d"}
_NUMBERS = {name: struct.Struct(f"<{code}") for name, code in _CODES.items()}
_TIME: Type = ("int32", "uint32")
_STATUS: Type = ("uint8", "string", "string", "string", [("string", "string")])
_SCALARS = ("bool", "int64", "float64", "string")
_SEQUENCES: tuple[Type, ...] = tuple([element] for element in ("uint8", *_SCALARS))
_PARAMETER: Type = ("string", ("uint8", *_SCALARS, *_SEQUENCES))


class Codec:
    """Reads and writes the messages of a type: tuples stand for structures and sequences."""

    def __init__(self, kind: Type) -> None:
        self._kind = kind
        self._read = _reader(kind)

    def read(self, data: bytes) -> Any:
        """Return a message's content. Raises ValueError."""
        if data[:ORIGIN] != _HEAD:
            raise ValueError("not a little-endian CDR message")
        cursor = Cursor(data)
        content = self._read(cursor)
        if cursor.at != len(data):
            raise ValueError(f"{len(data) - cursor.at} bytes too many")
        return content

    def write(self, content: Any) -> bytes:
        """Return a message with this content; padding is zeros."""
        message = bytearray(_HEAD)
        _write(message, self._kind, content)
        return bytes(message)


def _write(message: bytearray, kind: Type, content: Any) -> None:
    if isinstance(kind, tuple):
        for field, value in zip(kind, content, strict=True):
            _write(message, field, value)
    elif isinstance(kind, list):
        _write(message, "uint32", len(content))
        for element in content:
            _write(message, kind[0], element)
    elif kind == "string":
        text = content.encode() + b"\x00"
        _write(message, "uint32", len(text))
        message += text
    else:
        number = _NUMBERS[kind]
        message += bytes((ORIGIN - len(message)) % number.size) + number.pack(content)


def _reader(kind: Type) -> Callable[[Cursor], Any]:
    """Return the function that reads a value of a type: made once, as a message has hundreds of values."""
    if isinstance(kind, tuple):
        fields = [_reader(field) for field in kind]
        return lambda cursor: tuple([read(cursor) for read in fields])
    if isinstance(kind, list):
        element = _reader(kind[0])
        return lambda cursor: cursor.sequence(element)
    if kind == "string":
        return Cursor.string
    if kind == "bool":
        return lambda cursor: cursor.byte(1) == 1
    if kind == "uint8":
        return Cursor.byte
    size, unpack = _NUMBERS[kind].size, _NUMBERS[kind].unpack
    return lambda cursor: unpack(cursor.take(size, size))[0]


class Cursor:
    """Reads a message's parts one after the other, never past its end. Its methods raise ValueError."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = ORIGIN

    def take(self, size: int, alignment: int) -> bytes:
        """Read some bytes."""
        start = self.at + (ORIGIN - self.at) % alignment
        self.at = end = start + size
        if end > len(self.data):
            raise ValueError(f"a message of {len(self.data)} bytes ends before byte {end}")
        return self.data[start:end]

    def byte(self, largest: int = 255) -> int:
        """Read a byte."""
        (value,) = self.take(1, 1)
        if value > largest:
            raise ValueError(f"a byte of {value}, at most {largest} is allowed")
        return value

    def count(self) -> int:
        """Read the length of a string or a sequence."""
        return int.from_bytes(self.take(4, 4), "little")

    def sequence(self, element: Callable[[Cursor], Any]) -> tuple[Any, ...]:
        """Read a sequence, each element by this function."""
        count = self.count()
        if not count:
            return ()
        if count > len(self.data) - self.at:  # each takes a byte or more
            raise ValueError(f"{count} elements in {len(self.data) - self.at} bytes")
        return tuple([element(self) for _ in range(count)])

    def string(self, longest: int = sys.maxsize) -> str:
        """Read a text of at most so many bytes."""
        data = self.take(self.count(), 1)
        if data[-1:] != b"\x00":
            raise ValueError("a string without its terminator")
        if len(data) > longest + 1:
            raise ValueError(f"a name of {len(data) - 1} bytes, at most {longest} are read")
        return data[:-1].decode()

    def names(self, limit: int) -> tuple[str, ...]:
        """Read a sequence of names, at most so many."""
        count = self.count()
        if count > limit:
            self.take(4 * count, 4)  # no more than can be there
            raise ValueError(f"{count} names, at most {limit} are read")
        return tuple(self.string(MAX_NAME) for _ in range(count))

    def doubles(self) -> int:
        """Read past a sequence of doubles, and return how many there are."""
        count = self.count()
        if count:  # an empty sequence is not aligned
            self.take(8 * count, 8)
        return count


DIAGNOSTIC_ARRAY = Codec(((_TIME, "string"), [_STATUS]))
PARAMETER_EVENT = Codec((_TIME, "string", [_PARAMETER], [_PARAMETER], [_PARAMETER]))


# rmw_serialize leaves such a tail: room for alignment that empty arrays do not need.
MAX_TRAILING = 16
MAX_NAMES = 1024
_FRAME = ORIGIN + 8 + 4  # where its text begins, after the stamp and the length


def _words(piece: bytes) -> list[tuple[int, NDArray[Any]]]:
    """Return bytes as a few words, with where they begin; the last may overlap others."""
    width = next(width for width in (8, 4, 2, 1) if width <= len(piece))
    many, last = len(piece) // width, len(piece) - width
    pieces = [(0, np.frombuffer(piece, f"<u{width}", many))]
    if len(piece) % width:
        pieces.append((last, np.frombuffer(piece[last:], f"<u{width}")))
    return [(at, words if len(words) > 1 else words.reshape(())) for at, words in pieces]


class _FieldPlan:
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


@dataclass(frozen=True)
class JointStateLayout:
    """What is constant in a stream of JointState messages: names and numbers of values."""

    name: tuple[str, ...]
    position: int = 0
    velocity: int = 0
    effort: int = 0
    frame_id: str = ""

    @cached_property
    def _plan(self) -> _FieldPlan:
        plan = _FieldPlan()
        plan.string(self.frame_id)
        plan.count(len(self.name))
        for name in self.name:
            plan.string(name)
        for count in (self.position, self.velocity, self.effort):
            plan.doubles(count)
        return plan

    @cached_property
    def _struct(self) -> struct.Struct:
        return struct.Struct("".join(self._plan.format))

    @cached_property
    def _pieces(self) -> tuple[tuple[bytes, ...], ...]:
        return tuple(tuple(group) for group in self._plan.pieces)

    @cached_property
    def _counts(self) -> tuple[int, int, int]:
        return self.position, self.velocity, self.effort

    @cached_property
    def _constants(self) -> tuple[bytes, ...]:
        return CDR, *(piece for group in self._pieces for piece in group)

    @cached_property
    def _places(self) -> tuple[itemgetter[Any], slice, slice, slice]:
        """Where constants, positions, velocities and efforts are among the struct's fields."""
        at = 3  # after the encapsulation and the stamp
        constants, values = [0], []
        for pieces, count in zip(self._pieces, self._counts, strict=False):
            constants += range(at, at + len(pieces))
            at += len(pieces)
            values.append(slice(at, at + count))
            at += count
        position, velocity, effort = values
        return itemgetter(*constants), position, velocity, effort

    @property
    def size(self) -> int:
        """Length of a message in bytes."""
        return self._struct.size

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """The whole message: sec, nanosec, position[n], velocity[n], effort[n]."""
        doubles = [("<f8", (count,)) for count in self._counts]
        return np.dtype(
            {
                "names": ["sec", "nanosec", "position", "velocity", "effort"],
                "formats": ["<i4", "<u4", *doubles],
                "offsets": [ORIGIN, ORIGIN + 4, *self._plan.double_offsets],
                "itemsize": self.size,
            }
        )

    @cached_property
    def _constant_words(self) -> tuple[np.dtype[Any], dict[str, NDArray[Any]]]:
        """All bytes that are the same in every message of this layout, as whole numbers.

        They are the fields of a type over the whole message, and their values; fields may overlap.
        NumPy compares columns of such words several times faster than the same bytes one by one.
        """
        pieces = [piece for group in self._pieces for piece in group]
        spans = [(0, CDR), *zip(self._plan.piece_offsets, pieces, strict=True)]
        words = [(at + begin, words) for at, piece in spans for begin, words in _words(piece)]
        values = {f"byte {at}": value for at, value in words}
        dtype = np.dtype(
            {
                "names": list(values),
                "formats": [(value.dtype, value.shape) for value in values.values()],
                "offsets": [at for at, _ in words],
                "itemsize": self.size,
            }
        )
        return dtype, values

    def pack(self, sample: JointSample) -> bytes:
        """Return the message. Raises ValueError if the sample does not have this layout."""
        stamp_ns, name, position, velocity, effort = sample
        if name != self.name or (len(position), len(velocity), len(effort)) != self._counts:
            raise ValueError(f"a sample of {name!r} does not have the layout {self!r}")
        sec, nanosec = divmod(stamp_ns, NANOSECONDS)
        before_position, before_velocity, before_effort, _ = self._pieces
        try:
            return self._struct.pack(
                CDR,
                sec,
                nanosec,
                *before_position,
                *position,
                *before_velocity,
                *velocity,
                *before_effort,
                *effort,
            )
        except struct.error as error:
            raise ValueError(f"the sample at {stamp_ns} ns cannot be packed: {error}") from None

    def pack_rows(
        self, stamp_ns: NDArray[np.int64], **quantities: NDArray[np.float64]
    ) -> NDArray[np.void]:
        """Return N messages, one element each: the bytes of `pack`, without Python work for each.

        ``quantities`` are ``position``, ``velocity`` and ``effort`` [N, values], as many as the layout has.
        Raises ValueError for other shapes, and for stamps that no message can carry.
        """
        count = len(stamp_ns)
        if count and not -1 - LAST_STAMP_NS <= stamp_ns.min() <= stamp_ns.max() <= LAST_STAMP_NS:
            raise ValueError(f"stamps beyond {LAST_STAMP_NS} ns cannot be packed")
        zeros = JointSample(0, self.name, *((0.0,) * width for width in self._counts))
        whole = np.frombuffer(self.pack(zeros), f"V{self.size}").repeat(count)
        fields: NDArray[Any] = whole.view(self.dtype)
        fields["sec"], fields["nanosec"] = np.divmod(stamp_ns, NANOSECONDS)
        for quantity, width in zip(("position", "velocity", "effort"), self._counts, strict=True):
            values = quantities.get(quantity, np.empty((count, 0)))
            if values.shape != (count, width):
                raise ValueError(
                    f"{quantity} of shape {values.shape}: {width} values per message are needed"
                )
            fields[quantity] = values
        return whole

    def unpack(self, data: bytes) -> JointSample:
        """Return the sample. Raises ValueError if the message does not have this layout."""
        layout = self._struct
        if not layout.size <= len(data) <= layout.size + MAX_TRAILING:
            raise ValueError(f"a message of {len(data)} bytes does not have the layout {self!r}")
        fields = layout.unpack_from(data)
        constants, position, velocity, effort = self._places
        if constants(fields) != self._constants:
            raise ValueError(f"the message does not have the layout {self!r}")
        stamp_ns = fields[1] * NANOSECONDS + fields[2]
        return JointSample(stamp_ns, self.name, fields[position], fields[velocity], fields[effort])

    def decode_at(self, data: bytes, start: NDArray[np.int64]) -> NDArray[Any]:
        """Return the messages that begin at some bytes of ``data`` as an array of `dtype`.

        A view if they are equally spaced, otherwise a copy. Raises ValueError unless all
        have this layout.
        """
        return self._checked(self._whole(data, start))

    def fits(self, data: bytes, start: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return for each message that begins at some bytes of ``data`` if it has this layout [N].

        Raises ValueError if one would go beyond the data.
        """
        dtype, values = self._constant_words
        words = self._whole(data, start).view(dtype)
        fits = np.ones(len(words), np.bool_)
        for name, value in values.items():
            same = words[name] == value
            fits &= same if same.ndim == 1 else same.all(axis=1)
        return fits

    def _whole(self, data: bytes, start: NDArray[np.int64]) -> NDArray[np.void]:
        size = self.size
        if start[-1] + size > len(data):
            raise ValueError("messages of different sizes")
        step = int(start[1] - start[0]) if len(start) > 1 else size
        if step > 0 and (np.diff(start) == step).all():
            return np.ndarray((len(start),), f"V{size}", data, int(start[0]), (step,))
        everywhere: NDArray[np.void] = np.ndarray(
            (len(data) - size + 1,), f"V{size}", data, 0, (1,)
        )
        return everywhere[start]

    def _checked(self, whole: NDArray[np.void]) -> NDArray[Any]:
        dtype, values = self._constant_words
        words = whole.view(dtype)
        if any(np.count_nonzero(words[name] != value) for name, value in values.items()):
            raise ValueError("messages of different layouts")
        return whole.view(self.dtype)

    @classmethod
    def parse(cls, data: bytes) -> JointStateLayout:
        """Return a message's layout. Raises ValueError if it is malformed or big-endian."""
        if data[:2] != CDR:
            raise ValueError("not a little-endian CDR message")
        cursor = Cursor(data)
        cursor.take(8, 4)  # the stamp
        frame_id = cursor.string(MAX_NAME)
        name = cursor.names(MAX_NAMES)
        position, velocity, effort = (cursor.doubles() for _ in range(3))
        if len(data) - cursor.at > MAX_TRAILING:
            raise ValueError(f"{len(data) - cursor.at} bytes too many")
        return cls(name, position, velocity, effort, frame_id)


def frame_in(data: bytes) -> str:
    """Return the frame of a little-endian message; empty for anything else. Faster than its layout."""
    end = _FRAME + int.from_bytes(data[_FRAME - 4 : _FRAME], "little") - 1
    if data[:2] != CDR or not _FRAME < end <= min(_FRAME + MAX_NAME, len(data)):
        return ""
    return data[_FRAME:end].decode(errors="replace")


@lru_cache(maxsize=256)
def _layout(
    name: tuple[str, ...], position: int, velocity: int, effort: int, frame_id: str
) -> JointStateLayout:
    return JointStateLayout(name, position, velocity, effort, frame_id)


@lru_cache(maxsize=256)
def shared(layout: JointStateLayout) -> JointStateLayout:
    """Return an equal layout whose plan is made once for all chunks of a stream."""
    return layout


def layout_of(sample: JointSample, frame_id: str = "") -> JointStateLayout:
    """Return the layout that packs the sample, made once for all samples of its kind and frame."""
    _, name, position, velocity, effort = sample
    return _layout(name, len(position), len(velocity), len(effort), frame_id)
