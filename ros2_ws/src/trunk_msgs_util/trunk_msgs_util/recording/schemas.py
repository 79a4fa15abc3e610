"""ROS messages without ROS: definitions, and the few messages that an offline run builds.

Uses rosbags' store of Jazzy's types, loaded on first use, and `run_cdr`, which is enough for most reading.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..topics import DIAGNOSTIC_ARRAY_TYPE, PARAMETER_EVENT_TYPE
from ..units import NANOSECONDS
from . import run_cdr

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.typesys.store import Typestore

    from ..samples import Value

LEVEL_OK, LEVEL_WARN, LEVEL_ERROR = 0, 1, 2

# kind: (rcl_interfaces/ParameterType, field of ParameterValue)
_KINDS = {
    "bool": (1, "bool_value"),
    "integer": (2, "integer_value"),
    "double": (3, "double_value"),
    "string": (4, "string_value"),
    "byte array": (5, "byte_array_value"),
    "bool array": (6, "bool_array_value"),
    "integer array": (7, "integer_array_value"),
    "double array": (8, "double_array_value"),
    "string array": (9, "string_array_value"),
}
_FIELDS = dict(_KINDS.values())
_NOT_SET = 0
_ARRAYS = {"byte": np.uint8, "bool": np.bool_, "integer": np.int64, "double": np.float64}
_KIND_OF = {bool: "bool", int: "integer", float: "double", str: "string"}


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


@cache
def type_hash(type_name: str) -> str:
    """Return the hash of a type's description (REP 2016). Raises ValueError if it is unknown."""
    if type_name not in _store().fielddefs:
        raise ValueError(f"ROS 2 Jazzy has no message type {type_name!r}")
    return _store().hash_rihs01(type_name)


def build(type_name: str, **fields: Any) -> Any:
    """Return a message; sequences of numbers are NumPy arrays, all fields are given."""
    return _store().types[type_name](**fields)


def serialize(type_name: str, message: Any) -> bytes:
    """Return the message as little-endian CDR."""
    return bytes(_store().serialize_cdr(message, type_name, little_endian=True))


def deserialize(type_name: str, data: bytes) -> Any:
    """Return the message. Raises ValueError if the bytes are not of this type, or there is none."""
    try:
        return _store().deserialize_cdr(data, type_name)
    except Exception as error:  # whatever rosbags may raise on damaged bytes
        what = str(error) or type(error).__name__
        raise ValueError(f"not a {type_name}: {what}") from None


def _time(stamp_ns: int) -> Any:
    sec, nanosec = divmod(stamp_ns, NANOSECONDS)
    return build("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def stamp_of(time: Any) -> int:
    """Return a Time message as ns."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _kind(name: str, value: Value) -> str:
    if not isinstance(value, tuple):
        return _KIND_OF[type(value)]
    if not value:
        raise ValueError(f"parameter {name!r}: the kind of an empty array must be given")
    return _KIND_OF[type(value[0])] + " array"


def _no_values() -> dict[str, Any]:
    """Return the fields of a ParameterValue that is not set."""
    return {
        "bool_value": False,
        "integer_value": 0,
        "double_value": 0.0,
        "string_value": "",
        "string_array_value": [],
        **{f"{element}_array_value": np.array([], kind) for element, kind in _ARRAYS.items()},
    }


def _parameter(name: str, value: Value, kind: str) -> Any:
    fields = _no_values()
    number, field = _KINDS[kind]
    element = kind.removesuffix(" array")
    if isinstance(value, tuple):
        fields[field] = np.array(value, _ARRAYS[element]) if element in _ARRAYS else list(value)
    else:
        fields[field] = value
    return _with_value(name, number, fields)


def _with_value(name: str, number: int, fields: dict[str, Any]) -> Any:
    return build(
        "rcl_interfaces/msg/Parameter",
        name=name,
        value=build("rcl_interfaces/msg/ParameterValue", type=number, **fields),
    )


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
    told = kinds or {}

    def listed(values: Mapping[str, Value]) -> list[Any]:
        return [
            _parameter(name, value, told.get(name) or _kind(name, value))
            for name, value in values.items()
        ]

    message = build(
        PARAMETER_EVENT_TYPE,
        stamp=_time(stamp_ns),
        node=node,
        new_parameters=listed(new),
        changed_parameters=listed(changed),
        deleted_parameters=[_with_value(source, _NOT_SET, _no_values())] if source else [],
    )
    return serialize(PARAMETER_EVENT_TYPE, message)


def _values(parameters: list[Any]) -> dict[str, Value]:
    found: dict[str, Value] = {}
    for parameter in parameters:
        field = _FIELDS.get(parameter.value.type)
        if field is None:  # not set
            continue
        value = getattr(parameter.value, field)
        if field.endswith("array_value"):
            value = tuple(value if isinstance(value, list) else value.tolist())
        found[parameter.name] = value
    return found


def parse_parameter_event(data: bytes) -> ParameterChange:
    """Return the content of a serialized ParameterEvent. Raises ValueError if malformed."""
    found = run_cdr.parameter_event(data)
    if found is not None:
        return ParameterChange(
            found.sec * NANOSECONDS + found.nanosec,
            found.node,
            {name: values[kind - 1] for name, kind, values in found.new if kind in _FIELDS},
            {name: values[kind - 1] for name, kind, values in found.changed if kind in _FIELDS},
            _source([name for name, _, _ in found.deleted]),
        )
    message = deserialize(PARAMETER_EVENT_TYPE, data)
    return ParameterChange(
        stamp_of(message.stamp),
        message.node,
        _values(message.new_parameters),
        _values(message.changed_parameters),
        _source([parameter.name for parameter in message.deleted_parameters]),
    )


def _source(deleted: list[str]) -> str:
    """Return the source that a ParameterEvent names; empty if it names none."""
    return deleted[0] if len(deleted) == 1 else ""


def event(
    stamp_ns: int,
    node: str,
    message: str,
    values: Mapping[str, object] | None = None,
    level: int = LEVEL_OK,
    source: str = "",
) -> bytes:
    """Return a serialized DiagnosticArray with one status; values are written as text."""
    pairs = [
        build("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
        for key, value in (values or {}).items()
    ]
    status = build(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=node,
        message=message,
        hardware_id="trunk",
        values=pairs,
    )
    header = build("std_msgs/msg/Header", stamp=_time(stamp_ns), frame_id=source)
    return serialize(
        DIAGNOSTIC_ARRAY_TYPE, build(DIAGNOSTIC_ARRAY_TYPE, header=header, status=[status])
    )


def parse_event(data: bytes) -> RunEvent:
    """Return the content of a serialized DiagnosticArray. Raises ValueError if malformed or empty."""
    found = run_cdr.diagnostic_array(data)
    if found is not None:
        stamp_ns = found.sec * NANOSECONDS + found.nanosec
        pairs = dict(found.pairs)
        return RunEvent(stamp_ns, found.name, found.message, pairs, found.level, found.frame)
    message = deserialize(DIAGNOSTIC_ARRAY_TYPE, data)
    if not message.status:
        raise ValueError("a DiagnosticArray without a status")
    status = message.status[0]
    return RunEvent(
        stamp_of(message.header.stamp),
        status.name,
        status.message,
        {pair.key: pair.value for pair in status.values},
        status.level,
        message.header.frame_id,
    )
