"""Any topic as NumPy arrays, one per field, for any ROS 2 Jazzy type."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..topics import JOINT_STATE_TYPE
from .file import RecordingError
from .joint_arrays import QUANTITIES
from .schemas import deserialize

if TYPE_CHECKING:
    from .reader import Recording

LOG_TIME = "log_time_ns"


def topic_arrays(recording: Recording, topic: str) -> dict[str, NDArray[Any]]:
    """Return a topic's N messages as arrays [N] by field.

    JointState is decoded in bulk: ``stamp_ns`` and ``position[hip]`` and so on. Other messages are
    decoded one by one; nested field names are joined by dots (``header.stamp.sec``), and arrays and
    sequences become arrays of objects. `LOG_TIME` is always included.
    Raises RecordingError for an unknown topic, and if its messages are not of its type.
    """
    if topic not in recording.topics:
        raise RecordingError(
            f"{recording.path} has no topic {topic}, only {', '.join(recording.topics)}"
        )
    type_name = recording.topics[topic].type
    if type_name == JOINT_STATE_TYPE:
        joints = recording.joints(topic)
        columns = {
            f"{quantity}[{name}]": joints.column(quantity, name)
            for quantity in QUANTITIES
            if getattr(joints, quantity).shape[1]
            for name in joints.names
        }
        return {LOG_TIME: joints.log_time_ns, "stamp_ns": joints.stamp_ns, **columns}
    found: dict[str, list[Any]] = {LOG_TIME: []}
    for log_time_ns, messages in recording.messages(topic):
        found[LOG_TIME] += log_time_ns
        for data in messages:
            try:
                message = deserialize(type_name, data)
            except (ValueError, KeyError) as error:
                raise RecordingError(
                    f"{recording.path}: {topic} cannot be read as {type_name}: {error}"
                ) from None
            for name, value in _fields("", message):
                found.setdefault(name, []).append(value)
    return {name: _array(values) for name, values in found.items()}


def _fields(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a message's fields in order, those of nested messages by path."""
    if not hasattr(value, "__dataclass_fields__"):
        yield prefix, value
        return
    for name in value.__dataclass_fields__:
        if name != "__msgtype__":
            yield from _fields(f"{prefix}.{name}" if prefix else name, getattr(value, name))


def _array(values: list[Any]) -> NDArray[Any]:
    if all(isinstance(value, (bool, int, float, str)) for value in values):
        return np.array(values)
    objects = np.empty(len(values), object)
    for i, value in enumerate(values):  # assigned at once, arrays of equal length would be stacked
        objects[i] = value
    return objects
