"""Our reader against rosbags' on the same file, side by side in one run; arrays must be equal.

Ours opens the file, checks every checksum and returns arrays of stamps and values; theirs is
`rosbags.highlevel.AnyReader` with ``deserialize``, which returns one message at a time. Turning those
into arrays is not counted.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import QUANTITIES, JointArrays
from trunk_msgs_util.recording.reader import Recording

from ..errors import BenchError
from ..plans.plan import make_plan
from ..runs.offline_recording import record_offline
from .rates import RateRow

READ_GOAL = 15.0  # at least: our messages per second over those of rosbags


def bench_read(rounds: int = 5, duration: float = 20.0, path: Path | None = None) -> list[RateRow]:
    """Return the comparison on a recording, or on a simulated run of ``duration`` s.

    Raises BenchError unless the arrays are equal to the last bit.
    """
    if rounds < 1:
        raise BenchError(f"rounds must be 1 or greater, not {rounds!r}")
    with TemporaryDirectory() as folder:
        if path is None:
            path = Path(folder) / "run.mcap"
            everywhere = {"duration": duration, "update_rate": 1000.0}
            record_offline(make_plan("fig7", "fuzzy_pid", (), (), everywhere), path)
        return [_row(path, rounds)]


def _row(path: Path, rounds: int) -> RateRow:
    count = _agreed(path)
    sides: list[Callable[[], object]] = [lambda: ours(path), lambda: theirs(path)]
    times = []
    for i in range(rounds):
        elapsed_s = {}
        for side in sides if i % 2 else reversed(sides):
            start = perf_counter()
            side()
            elapsed_s[side] = perf_counter() - start
        times.append([elapsed_s[side] for side in sides])
    ratio = median(theirs_s / ours_s for ours_s, theirs_s in times)
    return RateRow(
        f"{count} JointState messages into arrays",
        count / median(ours_s for ours_s, _ in times),
        count / median(theirs_s for _, theirs_s in times),
        ratio,
        f">= {READ_GOAL:g}",
        ratio >= READ_GOAL,
    )


def ours(path: Path) -> dict[str, JointArrays]:
    """Return the arrays of all JointState topics."""
    recording = Recording.open(path)
    wanted = [
        name
        for name, topic in recording.topics.items()
        if topic.type == topics.JOINT_STATE_TYPE and topic.count
    ]
    return dict(recording.joints_of(wanted))


def theirs(path: Path) -> dict[str, list[Any]]:
    """Return all JointState messages."""
    messages: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        wanted = [c for c in reader.connections if c.msgtype == topics.JOINT_STATE_TYPE]
        for connection, _, data in reader.messages(wanted):
            message = reader.deserialize(data, connection.msgtype)
            messages.setdefault(connection.topic, []).append(message)
    return messages


def _agreed(path: Path) -> int:
    """Return the number of messages. Raises BenchError unless the two sides are equal."""
    arrays, messages = ours(path), theirs(path)
    if arrays.keys() != messages.keys():
        raise BenchError(f"{path}: rosbags reads {sorted(messages)}, we read {sorted(arrays)}")
    for topic, joints in arrays.items():
        listed = messages[topic]
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in listed]
        same = joints.stamp_ns.tolist() == stamps
        same &= all(tuple(m.name) == joints.names for m in listed)
        for quantity in QUANTITIES:
            stacked = np.array([getattr(m, quantity) for m in listed], np.float64)
            same &= stacked.tobytes() == getattr(joints, quantity).tobytes()
        if not same:
            raise BenchError(f"{path}: {topic}: rosbags reads other messages than we do")
    return sum(map(len, arrays.values()))
