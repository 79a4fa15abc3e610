"""What other libraries read in the same file: messages by topic, the trunk's true angles."""

import csv
import json
from collections import Counter
from functools import cache
from math import degrees
from pathlib import Path
from typing import Any

from mcap.reader import NonSeekingReader
from rosbags.typesys import Stores, get_typestore

from trunk_core.topics import JOINT_STATE_TYPE, PARAMETER_EVENT_TYPE

from .tampered import GIVEN, TRUTH

_MOST = 32 << 20  # bytes of messages: these libraries take them one by one


class UnreadableError(Exception):
    """The other library does not read this file, or not in reasonable time."""


@cache
def load() -> Any:
    """Return ROS 2's types as rosbags knows them."""
    return get_typestore(Stores.ROS2_JAZZY)


def read(path: Path) -> tuple[dict[str, int], list[tuple[int, float]]]:
    """Return the number of messages by topic, and the angles of the trunk by increasing stamp."""
    store = load()
    counts: Counter[str] = Counter()
    truth: list[Any] = []
    told: tuple[str, ...] = ()
    size = 0
    try:
        with path.open("rb") as file:
            reader = NonSeekingReader(file, validate_crcs=True)
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                counts[channel.topic] += 1
                size += len(message.data) + 64
                if size > _MOST:
                    raise UnreadableError("too much")
                kind = schema.name if schema else ""
                if channel.topic == TRUTH and kind == JOINT_STATE_TYPE:
                    truth += _decoded(store, message.data, kind)
                if channel.topic == GIVEN and kind == PARAMETER_EVENT_TYPE:
                    for event in _decoded(store, message.data, kind):
                        told = told or _joints(event)
    except Exception as error:
        raise UnreadableError(f"{type(error).__name__}: {error}") from None
    return dict(counts), _angles(truth, told)


def _decoded(store: Any, data: bytes, kind: str) -> list[Any]:
    try:
        return [store.deserialize_cdr(data, kind)]
    except Exception:
        return []


def _joints(event: Any) -> tuple[str, ...]:
    if event.node != "/simulator":
        return ()
    return next(
        (tuple(p.value.string_array_value) for p in event.new_parameters if p.name == "joints"), ()
    )


def _angles(truth: list[Any], told: tuple[str, ...]) -> list[tuple[int, float]]:
    found: dict[int, float] = {}
    trunk = told[1] if len(told) == 2 else "trunk"
    if not told and truth and "trunk" not in truth[0].name and len(truth[0].name) > 1:
        trunk = truth[0].name[1]
    for message in truth:
        lengths = {len(getattr(message, q)) for q in ("position", "velocity", "effort")}
        if lengths - {0, len(message.name)}:
            continue  # values that belong to no joint
        values = dict(zip(message.name, message.position.tolist(), strict=False))
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        found.setdefault(stamp, values.get(trunk, float("nan")))
    return sorted(found.items())


def wrong(path: Path, info: str, metrics: str, table: Path | None) -> list[str]:
    """Return where `info --json`, `metrics --json` and a table of `export` differ from `read`.

    Raises UnreadableError if there is nothing to compare with.
    """
    counts, angles = read(path)
    found: list[str] = []
    told = json.loads(info)
    ours = {name: t["messages"] for name, t in told["topics"].items() if t["messages"]}
    limited = any("limit" in w or "byte" in w for w in told["warnings"])
    if ours != counts and not limited:
        found.append(f"info counts {sum(ours.values())} messages, mcap {sum(counts.values())}")
    if any(n > counts.get(name, 0) for name, n in ours.items()):
        found.append("info counts messages that mcap does not")
    if table is not None and not limited:
        rows = list(csv.DictReader(table.read_text().splitlines()))
        read_back = [(float(row["t"]), repr(float(row["theta"]))) for row in rows]
        expected = [(stamp / 10**9, repr(angle)) for stamp, angle in angles]
        if read_back != expected:
            found.append("export has other angles than rosbags")
    if metrics and not limited:
        most = json.loads(metrics)["metrics"]["theta_max_deg"]
        if angles and most != degrees(max(angle for _, angle in angles)):
            found.append(f"metrics: the largest angle is {most}")
    return found
