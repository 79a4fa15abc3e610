"""ROS messages without ROS: definitions, and a run's own record, its events and parameters.

Uses rosbags' store of Jazzy's types, loaded on first use, and `cdr`, which is enough for that record.
"""

from __future__ import annotations

import re
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trunk_core.topics import DIAGNOSTIC_ARRAY_TYPE, LEVEL_OK, PARAMETER_EVENT_TYPE
from trunk_core.units import NANOSECONDS

from . import cdr

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rosbags.typesys.store import Typestore

    from trunk_core.samples import Value


# The kinds of parameters; the place is that of rcl_interfaces/ParameterType, 0 being "not set".
_KINDS = (
    "",
    *("bool", "integer", "double", "string"),
    *("byte array", "bool array", "integer array", "double array", "string array"),
)
_KIND_OF = {bool: "bool", int: "integer", float: "double", str: "string"}
_NO_VALUES = (False, 0, 0.0, "", (), (), (), (), ())


class ParameterChange(NamedTuple):
    """One message on ``run/parameters``: a node's initial set, or what changed after a stamp."""

    stamp_ns: int
    node: str  # fully qualified
    new: dict[str, Value]
    changed: dict[str, Value]
    source: str = ""  # NODE@PROCESS in real time


class RunEvent(NamedTuple):
    """One message on ``run/events``."""

    stamp_ns: int
    node: str
    message: str
    values: dict[str, str]
    level: int
    source: str = ""  # NODE@PROCESS in real time


@cache
def _store() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@cache
def definition(type_name: str) -> bytes:
    """Return a type's ``ros2msg`` text with all nested types. Raises ValueError if unknown."""
    if type_name not in _store().fielddefs:
        raise ValueError(f"ROS 2 Jazzy has no message type {type_name!r}")
    text, _ = _store().generate_msgdef(type_name, ros_version=2)
    return text.encode()


def describes(text: bytes, type_name: str) -> bool:
    """Return True if a ``ros2msg`` text has a type's fields; comments and the order of nested types are free.

    Raises ValueError for an unknown type.
    """
    ours, theirs = (
        [
            [*filter(None, part.split(b"\n"))]
            for part in re.split(rb"\n=+\n", re.sub(rb"#[^\n]*|[ \t\r]|\bmsg/", b"", each))
        ]
        for each in (definition(type_name), text)
    )
    return ours[0] == theirs[0] and sorted(ours) == sorted(theirs)


@cache
def type_hash(type_name: str) -> str:
    """Return the hash of a type's description (REP 2016). Raises ValueError if it is unknown."""
    if type_name not in _store().fielddefs:
        raise ValueError(f"ROS 2 Jazzy has no message type {type_name!r}")
    return _store().hash_rihs01(type_name)


def build(type_name: str, **fields: Any) -> Any:
    """Return a message; one in it may be given as a mapping, and what is not given is zero or empty."""
    return _filled(type_name, fields)


def serialize(type_name: str, message: Any) -> bytes:
    """Return the message as little-endian CDR."""
    return bytes(_store().serialize_cdr(message, type_name, little_endian=True))


def _filled(kind: Any, given: Any) -> Any:
    """Return a field as rosbags takes it; ``kind`` is what its definition says beside the kind of node."""
    if isinstance(kind, str):  # a message
        if hasattr(given, "__msgtype__"):
            return given
        fields = {name: _filled(of, (given or {}).get(name)) for name, (_, of) in _fields(kind)}
        return _store().types[kind](**fields)
    element, _ = kind
    if isinstance(element, str):  # a number or a text
        return given if given is not None else "" if element == "string" else 0
    _, of = element
    if isinstance(of, str):
        return [_filled(of, item) for item in given or ()]
    return np.array(() if given is None else given, of[0])


def _fields(type_name: str) -> Any:
    return _store().fielddefs[type_name][1]


def deserialize(type_name: str, data: bytes) -> Any:
    """Return the message. Raises ValueError if the bytes are not of this type, or there is none."""
    try:
        return _store().deserialize_cdr(data, type_name)
    except Exception as error:  # whatever rosbags may raise on damaged bytes
        reason = str(error) or type(error).__name__
        raise ValueError(f"not a {type_name}: {reason}") from None


def _kind(name: str, value: Value) -> str:
    if not isinstance(value, tuple):
        return _KIND_OF[type(value)]
    if not value:
        raise ValueError(f"parameter {name!r}: the kind of an empty array must be given")
    return _KIND_OF[type(value[0])] + " array"


def _parameter(name: str, value: Value, kind: str) -> Any:
    """Return a Parameter as `cdr.PARAMETER_EVENT` has it."""
    number = _KINDS.index(kind)
    values = list(_NO_VALUES)
    values[number - 1] = value
    return name, (number, *values)


def parameter_event(
    stamp_ns: int,
    node: str,
    new: Mapping[str, Value],
    changed: Mapping[str, Value],
    kinds: Mapping[str, str] | None = None,
    source: str = "",
) -> bytes:
    """Return a serialized ParameterEvent.

    A ``source`` is the one deleted parameter, a name without a value: the message has no header for it.
    ``kinds`` gives kinds by name, as `declarations.Declaration.kind` has them; others are taken
    from the value. Raises ValueError for an empty array whose kind is not given.
    """
    given = kinds or {}
    new_parameters, changed_parameters = (
        [_parameter(name, value, given.get(name) or _kind(name, value)) for name, value in values]
        for values in (new.items(), changed.items())
    )
    deleted = [(source, (0, *_NO_VALUES))] if source else []
    stamp = divmod(stamp_ns, NANOSECONDS)
    event = (stamp, node, new_parameters, changed_parameters, deleted)
    return cdr.PARAMETER_EVENT.write(event)


def parse_parameter_event(data: bytes) -> ParameterChange:
    """Return the content of a serialized ParameterEvent. Raises ValueError if malformed."""
    stamp, node, new, changed, deleted = _content(cdr.PARAMETER_EVENT, PARAMETER_EVENT_TYPE, data)
    source = deleted[0][0] if len(deleted) == 1 else ""
    return ParameterChange(_stamp_ns(stamp), node, _values(new), _values(changed), source)


def _values(parameters: Iterable[Any]) -> dict[str, Value]:
    return {
        name: values[kind - 1]
        for name, (kind, *values) in parameters
        if 0 < kind < len(_KINDS)  # else it is not set
    }


def _content(codec: cdr.Codec, type_name: str, data: bytes) -> Any:
    """Return a message's content as tuples; by rosbags, if it is not in the plain form of ROS 2.

    Raises ValueError.
    """
    with suppress(ValueError):
        return codec.read(data)
    return _as_tuples(deserialize(type_name, data))


def _as_tuples(value: Any) -> Any:
    if hasattr(value, "__msgtype__"):
        return tuple(_as_tuples(getattr(value, name)) for name, _ in _fields(value.__msgtype__))
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


def _stamp_ns(stamp: tuple[int, int]) -> int:
    sec, nanosec = stamp
    return sec * NANOSECONDS + nanosec


def event(
    stamp_ns: int,
    node: str,
    message: str,
    values: Mapping[str, object] | None = None,
    level: int = LEVEL_OK,
    source: str = "",
) -> bytes:
    """Return a serialized DiagnosticArray with one status; values are written as text."""
    pairs = [(key, str(value)) for key, value in (values or {}).items()]
    header = (divmod(stamp_ns, NANOSECONDS), source)
    status = (level, node, message, "trunk", pairs)
    return cdr.DIAGNOSTIC_ARRAY.write((header, [status]))


def parse_event(data: bytes) -> RunEvent:
    """Return the content of a serialized DiagnosticArray. Raises ValueError if malformed or empty."""
    (stamp, source), statuses = _content(cdr.DIAGNOSTIC_ARRAY, DIAGNOSTIC_ARRAY_TYPE, data)
    if not statuses:
        raise ValueError("a DiagnosticArray without a status")
    level, node, message, _, pairs = statuses[0]
    return RunEvent(_stamp_ns(stamp), node, message, dict(pairs), level, source)
