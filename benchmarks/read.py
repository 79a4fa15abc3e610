"""Our reader against rosbags' on the same file, side by side in one run; arrays must be equal.

Ours opens the file, checks every checksum and returns arrays of stamps and values; theirs is
`rosbags.highlevel.AnyReader` with ``deserialize``, which returns one message at a time. Turning those
into arrays is not counted.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from trunk_core import topics
from trunk_recording.joint_table import QUANTITIES, JointTable
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from .harness import BenchError, Row

READ_GOAL = 15.0  # at least: our messages per second over those of rosbags


def compare(rounds: int = 5, duration: float = 20.0, run: str = "") -> list[Row]:
    """Compare our reader with rosbags on RUN, or on a simulated run; the arrays must be equal."""
    with TemporaryDirectory() as folder:
        path = Path(run or f"{folder}/run.mcap")
        if not run:
            everywhere = {"duration": duration, "update_rate": 1000.0}
            record_offline(make_plan("fig7", "fuzzy_pid", (), (), everywhere), path)
        count = _agreed(path)
        times: dict[Any, list[float]] = {ours: [], theirs: []}
        for i in range(rounds):
            for side in (ours, theirs) if i % 2 else (theirs, ours):
                start = perf_counter()
                side(path)
                times[side].append((perf_counter() - start) / count)
    name = f"{count} JointState messages into arrays: their time / ours"
    return [Row.of(name, times[ours], times[theirs], "us", at_least=READ_GOAL, inverse=True)]


def ours(path: Path) -> dict[str, JointTable]:
    """Return the arrays of all JointState topics."""
    recording = Recording.open(path)
    wanted = [
        name
        for name, topic in recording.topics.items()
        if topic.type == topics.JOINT_STATE_TYPE and topic.count
    ]
    return recording.tables(dict.fromkeys(wanted))


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
