"""Messages of a recording, taken apart and put together again with something changed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ros2_ws.src.trunk_msgs_util.test.mcap_files import Content

from trunk_msgs_util.recording.joint_state_cdr import JointStateLayout
from trunk_msgs_util.recording.schemas import deserialize, serialize
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.topics import DIAGNOSTIC_ARRAY_TYPE, PARAMETER_EVENT_TYPE
from trunk_msgs_util.units import NANOSECONDS

EVENTS, PARAMETERS = "/run/events", "/run/parameters"
TYPES = {EVENTS: DIAGNOSTIC_ARRAY_TYPE, PARAMETERS: PARAMETER_EVENT_TYPE}
TOPIC, LOG, DATA, PUBLISH, SEQUENCE = range(5)  # places in a message of `Content`

Change = Callable[[JointSample], JointSample]


class Edit(NamedTuple):
    """A change of a recording's content; ``kind`` groups edits in the report."""

    kind: str
    name: str
    apply: Callable[[Content], object]


def sample_of(message: list[Any]) -> JointSample:
    """Return a JointState message's sample."""
    return JointStateLayout.parse(message[DATA]).unpack(message[DATA])


def put(message: list[Any], sample: JointSample, frame_id: str = "") -> None:
    """Make a JointState message from a sample; in simulated time the log time goes with the stamp."""
    layout = JointStateLayout(
        sample.name, len(sample.position), len(sample.velocity), len(sample.effort), frame_id
    )
    with_log = message[LOG] == max(sample_of(message).stamp_ns, 0)
    message[DATA] = layout.pack(sample)
    if with_log:
        message[LOG] = message[PUBLISH] = max(sample.stamp_ns, 0)


def renumber(found: Content) -> None:
    """Give every topic's messages consecutive sequence numbers, as the recorder does."""
    counts: Counter[str] = Counter()
    for message in found.messages:
        message[SEQUENCE] = counts[message[TOPIC]]
        counts[message[TOPIC]] += 1


def parsed(message: list[Any]) -> Any:
    """Return the message of an event or of parameters."""
    return deserialize(TYPES[message[TOPIC]], message[DATA])


def store(message: list[Any], value: Any) -> None:
    """Put a message of an event or of parameters back."""
    message[DATA] = serialize(TYPES[message[TOPIC]], value)


def move(message: list[Any], value: Any, stamp: Any, by_ns: int) -> None:
    """Move a stamp of ``value``, and in simulated time the log time with it."""
    before = stamp.sec * NANOSECONDS + stamp.nanosec
    after = max(before + by_ns, -1)
    stamp.sec, stamp.nanosec = divmod(after, NANOSECONDS)
    if message[LOG] == max(before, 0):
        message[LOG] = message[PUBLISH] = max(after, 0)
    store(message, value)


def with_field(sample: JointSample, quantity: str, index: int, value: float) -> JointSample:
    """Return the sample with another value in one place."""
    values = list(getattr(sample, quantity))
    values[index] = value
    return sample._replace(**{quantity: tuple(values)})


# What is done to a number; each changes its bits.
NUMBERS: Mapping[str, Callable[[float], float]] = {
    "one ULP": lambda v: math.nextafter(v, math.inf),
    "times 1.1": lambda v: v * 1.1 if v else 0.1,
    "sign": lambda v: -v,
    "NaN": lambda v: math.nan,
    "infinite": lambda v: math.inf,
}
