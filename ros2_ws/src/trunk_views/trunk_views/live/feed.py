"""What the gateway shows: texts on a board, streams of rows; and its messages, JSON. Pure.

A frame of rows is a sequence of little-endian doubles: the number of the stream, the columns of a row, the
number of the first row, then the rows.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, NamedTuple, Protocol

import numpy as np

from trunk_control.fuzzy import fired_at
from trunk_control.rule_base import RuleBaseConfig
from trunk_core.arrays import Floats
from trunk_core.errors import TrunkError
from trunk_core.samples import JointSample
from trunk_core.units import seconds

NAME = "trunk.live.1"  # the WebSocket's subprotocol
LONGEST = 65_536  # bytes of a message from a page
ENDED = 4000  # closes a WebSocket whose server will not come back


class BadMessageError(TrunkError, ValueError):
    """A message that our page never sends: what is wrong with it."""


class Asked(NamedTuple):
    """A page's request. ``number``: the page's number for it, which the answer repeats."""

    kind: str
    number: int
    values: Mapping[str, Any]


# What each kind carries, and of which type; a float may be written as an integer.
_CARRIES: Mapping[str, Mapping[str, type]] = {
    "push": {"force": float, "torque": float},
    "reference": {"angle": float},
    "set": {"node": str, "values": dict},
    "swap": {"to": str},
    "reset": {},
    "pause": {"on": bool},
    "stop": {},
}
KINDS = tuple(_CARRIES)
# These come at the screen's refresh rate and are not answered.
UNANSWERED = ("push", "reference")


def asked(text: str | bytes) -> Asked:
    """Return the request in a message. Raises BadMessageError."""
    if isinstance(text, bytes):
        raise BadMessageError("a binary message: only JSON text is understood")
    try:
        fields = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise BadMessageError("a message that is not JSON") from None
    if not isinstance(fields, dict):
        raise BadMessageError("a message that is not a JSON object")
    kind, number = fields.pop("kind", None), fields.pop("number", 0)
    if not isinstance(kind, str) or kind not in _CARRIES:
        raise BadMessageError(f"a message of a kind other than {', '.join(KINDS)}")
    if type(number) is not int:
        raise BadMessageError(f"{kind}: its number is not an integer")
    carries = _CARRIES[kind]
    if fields.keys() != carries.keys():
        raise BadMessageError(
            f"{kind}: it must carry these fields only: {', '.join(carries) or 'none'}"
        )
    return Asked(kind, number, {n: _value(kind, n, t, fields[n]) for n, t in carries.items()})


def _value(kind: str, name: str, wanted: type, value: object) -> object:
    if wanted is float and type(value) in (int, float):
        number = float(value) if abs(value) < 1e300 else float("inf")  # type: ignore[arg-type]
        if isfinite(number):
            return number
    elif type(value) is wanted:
        return value
    raise BadMessageError(f"{kind}: {name} is not a finite {wanted.__name__}")


def _no_number(text: str) -> float:
    raise ValueError(text)


def words(kind: str, **values: object) -> str:
    """Return a message to a page."""
    return json.dumps({"kind": kind, **values}, allow_nan=False, separators=(",", ":"))


def plain(value: object) -> object:
    """Return a value as JSON has it: tuples as lists, what is not finite as text."""
    if isinstance(value, float) and not isfinite(value):
        return repr(value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


PLANT = "plant"  # the name of the stream of true states
PUSHES = "pushes"  # of what was taken from an operator
PLANT_COLUMNS = ("t", "x", "theta", "x_dot", "theta_dot", "torque")  # s, m, rad, m/s, rad/s, N m
PUSH_COLUMNS = ("t", "force", "torque")  # s, N, N m
# Where the four rules that fire begin, and the weights of (row, column), (row, column + 1) ...
RULE_COLUMNS = ("row", "column", "w00", "w01", "w10", "w11")
_MOST_ROWS = 4_000  # in one frame


class Board:
    """Pieces of text by kind and name. A reader keeps the version of the last piece that it has read."""

    def __init__(self) -> None:
        self._version = 0
        self._pieces: dict[tuple[str, str], tuple[int, str]] = {}

    def put(self, kind: str, name: str = "", **values: object) -> None:
        """Replace a piece's last version; nothing changes if both are equal."""
        text = words(kind, **({"name": name} if name else {}), **values)
        if self._pieces.get((kind, name), (0, ""))[1] != text:
            self._version += 1
            self._pieces.pop(
                (kind, name), None
            )  # so that the pieces stay in the order of their versions
            self._pieces[kind, name] = self._version, text

    def after(self, version: int) -> tuple[int, str] | None:
        """Return the oldest piece newer than a version, and its own version; None if there is none."""
        if version >= self._version:
            return None
        return next(piece for piece in self._pieces.values() if piece[0] > version)

    def texts(self) -> list[str]:
        """Return the last version of all pieces."""
        return [text for _, text in self._pieces.values()]


class StreamRows:
    """The last ``kept`` rows of a stream; a reader knows a row by its number since the beginning."""

    def __init__(self, names: Sequence[str], kept: int) -> None:
        self.names = tuple(names)
        self.count = 0  # of all rows ever added
        self._kept = kept
        # Twice as many as are kept, so that those are always in one piece.
        self._values: Floats = np.empty((2 * kept, len(self.names)))
        self._end = 0

    @property
    def oldest(self) -> int:
        """The number of the oldest row that is still there."""
        return self.count - min(self._end, self._kept)

    def add(self, row: Sequence[float]) -> None:
        """Add a row, one number for each name; the oldest is dropped."""
        if self._end == len(self._values):
            self._values[: self._kept] = self._values[self._end - self._kept :]
            self._end = self._kept
        self._values[self._end] = row
        self._end += 1
        self.count += 1

    def last(self) -> dict[str, float]:
        """Return the newest row by name; empty where there is none."""
        if not self.count:
            return {}
        return dict(zip(self.names, self._values[self._end - 1].tolist(), strict=True))

    def since(self, number: int, most: int) -> tuple[int, Floats]:
        """Return the first row's number and up to ``most`` rows, from this number or the oldest on."""
        first = max(number, self.oldest)
        begin = self._end - (self.count - first)
        return first, self._values[begin : min(begin + most, self._end)]


def frame(stream: int, rows: StreamRows, number: int) -> tuple[bytes, int]:
    """Return the frame of a stream's next rows, and the number after the last of them; none: empty."""
    first, values = rows.since(number, _MOST_ROWS)
    if not len(values):
        return b"", first
    head = np.array([stream, values.shape[1], first], np.float64)
    return head.astype("<f8").tobytes() + values.astype("<f8").tobytes(), first + len(values)


class RefusedRequestError(TrunkError):
    """A page's request that is refused, and why."""


class Stream(NamedTuple):
    """Rows with their name: ``plant``, ``pushes``, or a controller's."""

    name: str
    rows: StreamRows


class Feed(Protocol):
    """A source of streams and texts."""

    board: Board
    streams: list[Stream]

    async def begin(self) -> None:
        """Do what is needed only once, while turns are taken."""

    def turn(self) -> None:
        """Take what has come since the last turn; never waits."""

    async def ask(self, client: str, asked: Asked) -> str:
        """Do what a client asks for; return the answer. Raises RefusedRequestError."""

    def close(self) -> None:
        """Release what was opened."""


def put_stream(board: Board, streams: list[Stream], name: str, rows: StreamRows) -> None:
    """Open a stream, and announce it."""
    board.put("stream", name, stream=len(streams), columns=list(rows.names))
    streams.append(Stream(name, rows))


def columns_of(name: str, said: Sequence[str], config: Any) -> tuple[str, ...]:
    """Return the columns of a stream; ``said``: the names in its messages, ``config``: its node's."""
    fixed = {PLANT: PLANT_COLUMNS, PUSHES: PUSH_COLUMNS}.get(name)
    if fixed is not None:
        return fixed
    rules = RULE_COLUMNS if isinstance(config, RuleBaseConfig) else ()
    return ("t", *said, *rules)


def row_of(name: str, sample: JointSample) -> tuple[float, ...] | None:
    """Return a message as a row; None where it is not what the stream carries."""
    if sample.stamp_ns < 0:
        return None
    t = seconds(sample.stamp_ns)
    position, velocity, effort = sample.position, sample.velocity, sample.effort
    if name == PLANT:
        if not len(position) == len(velocity) == len(effort) == 2:
            return None
        return t, *position, *velocity, effort[1]
    if name == PUSHES:
        return (t, *effort) if len(effort) == 2 else None
    return (t, *position) if len(position) == len(sample.name) else None


def with_rules(
    row: tuple[float, ...], said: Sequence[str], config: RuleBaseConfig
) -> tuple[float, ...]:
    """Return a controller's row with the rules that fired for it; unchanged if it has no error and rate."""
    if "error" not in said or "error_rate" not in said:
        return row
    error, rate = row[1 + said.index("error")], row[1 + said.index("error_rate")]
    fired = fired_at(error, rate, *config.peaks)
    return (*row, fired[0].row, fired[0].column, *(rule.weight for rule in fired))
