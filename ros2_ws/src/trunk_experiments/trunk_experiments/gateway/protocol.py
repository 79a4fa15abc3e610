"""Messages between page and gateway: JSON. Pure."""

from __future__ import annotations

import json
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from trunk_msgs_util.errors import TrunkError

if TYPE_CHECKING:
    from collections.abc import Mapping

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
