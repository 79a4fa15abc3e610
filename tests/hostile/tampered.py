"""Recordings of a run that were changed: something left out, put in, or renamed, as in other robots' bags."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import partial
from math import inf, nan
from pathlib import Path
from typing import Any

from mcap.records import Schema
from ros2_ws.src.trunk_msgs_util.test.mcap_files import NONE, Content, content, write_file

from trunk_msgs_util.recording import schemas
from trunk_msgs_util.recording.joint_state_cdr import JointStateLayout
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.topics import DIAGNOSTIC_ARRAY_TYPE, JOINT_STATE_TYPE

TRUTH, SEEN = "/ground_truth/joint_states", "/joint_states"
COMMAND, DISTURBANCE, STATE = "/effort_command", "/disturbance", "/pid/state"
GIVEN, SAID = "/run/parameters", "/run/events"
FAR_NS = (2**31 - 1) * 10**9

Rows = list[list[Any]]  # messages: topic, log time in ns, bytes, publish time in ns, sequence
Change = Callable[[Content], Rows | None]


def edited(change: Change, base: Path, path: Path) -> Path:
    """Write ``base`` with its messages changed, without digests."""
    run = content(base)
    run.messages = change(run) or run.messages
    for row in run.messages:
        row[1] = row[3] = max(row[1], 0)
    for name in run.channels.keys() - {row[0] for row in run.messages}:
        del run.channels[name]
    write_file(run, path, NONE)
    return path


def joint_state(
    ns: int,
    names: Sequence[str],
    position: Sequence[float] = (),
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
    frame: str = "",
) -> bytes:
    """Return a JointState message; it may have more or fewer values than names."""
    values = tuple(position), tuple(velocity), tuple(effort)
    layout = JointStateLayout(tuple(names), *map(len, values), frame)
    return layout.pack(JointSample(ns, layout.name, *values))


def sample(data: bytes) -> dict[str, Any]:
    """Return a JointState as the arguments of `joint_state`."""
    message = schemas.deserialize(JOINT_STATE_TYPE, data)
    return {
        "ns": schemas.stamp_of(message.header.stamp),
        "names": list(message.name),
        "position": message.position.tolist(),
        "velocity": message.velocity.tolist(),
        "effort": message.effort.tolist(),
    }


def joints(
    topics: tuple[str, ...], change: Callable[[dict[str, Any], int], Any], run: Content
) -> None:
    """Change every message of some JointState topics, given as arguments and a running number."""
    for topic in topics:
        for i, row in enumerate(run.of(topic)):
            arguments = sample(row[2])
            change(arguments, i)
            row[2] = joint_state(**arguments)


def _without(quantity: str) -> Callable[[dict[str, Any], int], Any]:
    return lambda a, i: a.update({quantity: []})


def _renamed(*names: str) -> Callable[[dict[str, Any], int], Any]:
    return lambda a, i: a.update({"names": list(names)[: len(a["names"])] or list(names)})


def _set(quantity: str, value: float, at: int) -> Callable[[dict[str, Any], int], Any]:
    def change(a: dict[str, Any], i: int) -> None:
        if i == at:
            a[quantity] = [value] * len(a[quantity])

    return change


def _stamped(ns: Callable[[int, int], int]) -> Callable[[dict[str, Any], int], Any]:
    return lambda a, i: a.update({"ns": ns(a["ns"], i)})


def dropped(topic: str, run: Content) -> Rows:
    """Return all messages but a topic's."""
    return [row for row in run.messages if row[0] != topic]


def _garbage(topic: str, data: bytes, at: Callable[[int], bool], run: Content) -> None:
    for i, row in enumerate(run.of(topic)):
        if at(i):
            row[2] = data


def _added(topic: str, data: bytes, run: Content) -> Rows:
    return [*run.messages, [topic, run.messages[-1][1], data, 0, 0]]


def parameters(change: Callable[[str, dict[str, Any]], Any], run: Content) -> None:
    """Change the nodes' first parameters."""
    for row in run.of(GIVEN):
        found = schemas.parse_parameter_event(row[2])
        values = dict(found.new)
        if not values:
            continue
        change(found.node, values)
        kinds = {name: "double array" for name, value in values.items() if value == ()}
        row[2] = schemas.parameter_event(found.stamp_ns, found.node, values, {}, kinds)


def _parameter(node: str, name: str, value: Any) -> Callable[[Content], None]:
    def change(at: str, values: dict[str, Any]) -> None:
        if at == node:
            values[name] = value

    return partial(parameters, change)


def _no_status() -> bytes:
    message = schemas.build(
        DIAGNOSTIC_ARRAY_TYPE,
        header=schemas.build(
            "std_msgs/msg/Header",
            stamp=schemas.build("builtin_interfaces/msg/Time", sec=0, nanosec=0),
            frame_id="",
        ),
        status=[],
    )
    return schemas.serialize(DIAGNOSTIC_ARRAY_TYPE, message)


def _typed(topic: str, kind: str, run: Content) -> None:
    number = max(run.schemas) + 1
    run.schemas[number] = Schema(number, b"", "ros2msg", kind)
    run.channels[topic].schema_id = number


def _alternating(a: dict[str, Any], i: int) -> None:
    keep = slice(i % 2, i % 2 + 1)
    for key in ("names", "position", "velocity", "effort"):
        a[key] = a[key][keep]


def _big_endian(run: Content) -> None:
    for row in run.of(TRUTH):
        a = sample(row[2])
        data = b"\0\0\0\0" + struct.pack(">iI", *divmod(a["ns"], 10**9)) + struct.pack(">I", 1)
        data += b"\0\0\0\0" + struct.pack(">I", len(a["names"]))
        for name in a["names"]:
            data += bytes(-(len(data) - 4) % 4) + struct.pack(">I", len(name) + 1)
            data += name.encode() + b"\0"
        for quantity in ("position", "velocity", "effort"):
            values = a[quantity]
            data += bytes(-(len(data) - 4) % 4) + struct.pack(">I", len(values))
            data += bytes(-(len(data) - 4) % 8) if values else b""
            data += struct.pack(f">{len(values)}d", *values)
        row[2] = data


def _not_utf8(run: Content) -> None:
    for row in run.of(TRUTH):
        row[2] = row[2].replace(b"hip\0", b"\xff\xfe\xc3\0").replace(b"trunk\0", b"trunk\xc3\0")


def _arm(run: Content) -> Rows:
    names = [f"joint_{i}" for i in range(7)]
    return [
        [SEEN, k * 10**7, joint_state(k * 10**7, names, [0.1 * k] * 7), 0, 0] for k in range(300)
    ]


def _unknown_controller(run: Content) -> None:
    channel = run.channels.pop(STATE)
    channel.topic = "/strange/state"
    run.channels[channel.topic] = channel
    for row in run.of(STATE):
        row[0] = channel.topic


_EVERY = (TRUTH, SEEN, COMMAND, DISTURBANCE)
_CHANGES: dict[str, Change] = {
    **{
        f"{topic.strip('/').replace('/', '.')} without {quantity}": partial(
            joints, (topic,), _without(quantity)
        )
        for topic in (SEEN, TRUTH)
        for quantity in ("position", "velocity", "effort")
    },
    "commands without effort": partial(joints, (COMMAND,), _without("effort")),
    "terms without position": partial(joints, (STATE,), _without("position")),
    "disturbance without effort": partial(joints, (DISTURBANCE,), _without("effort")),
    "measured joints renamed": partial(joints, (SEEN,), _renamed("a", "b")),
    "true joints renamed": partial(joints, (TRUTH,), _renamed("a", "b")),
    "command's joint renamed": partial(joints, (COMMAND,), _renamed("elbow")),
    "all joints renamed": partial(joints, _EVERY, _renamed("a", "b")),
    "true joints swapped": partial(joints, (TRUTH,), _renamed("trunk", "hip")),
    "both joints of one name": partial(joints, (TRUTH, SEEN), _renamed("trunk", "trunk")),
    "joints without a name": partial(joints, (TRUTH,), _renamed("", "")),
    "names that are not UTF-8": _not_utf8,
    "more names than values": partial(
        joints, (TRUTH,), lambda a, i: a.update({"names": ["hip", "trunk", "knee"]})
    ),
    "no names at all": partial(joints, (TRUTH,), lambda a, i: a.update({"names": []})),
    "three joints": partial(
        joints,
        (TRUTH, SEEN),
        lambda a, i: a.update(
            {key: [*a[key], a[key][0]] for key in ("position", "velocity", "effort")}
            | {"names": ["hip", "trunk", "knee"]}
        ),
    ),
    "one joint a message": partial(joints, (TRUTH, SEEN), _alternating),
    **{
        f"no {topic.strip('/')}": partial(dropped, topic) for topic in (*_EVERY, STATE, GIVEN, SAID)
    },
    "nothing but true states": lambda run: run.of(TRUTH),
    "only the first state": lambda run: [
        row for row in run.messages if row[0] not in (*_EVERY, STATE) or sample(row[2])["ns"] == 0
    ],
    "another joint parameter": _parameter("/pid", "joint", "elbow"),
    "another hip parameter": _parameter("/pid", "hip_joint", "knee"),
    "other joints in the parameters": _parameter("/simulator", "joints", ("a", "b")),
    "a rate that is a text": _parameter("/simulator", "update_rate", "fast"),
    "a rate of 0 Hz": _parameter("/simulator", "update_rate", 0.0),
    "a rate of 1e300 Hz": _parameter("/simulator", "update_rate", 1e300),
    "a rate of 1e-300 Hz": _parameter("/simulator", "update_rate", 1e-300),
    "a rate that is NaN": _parameter("/simulator", "update_rate", nan),
    "a limit that is NaN": _parameter("/simulator", "max_effort", nan),
    "a seed of 2^63 - 1": _parameter("/simulator", "seed", 2**63 - 1),
    "a million pulses": _parameter(
        "/disturbance", "pulse.times", tuple(float(i) for i in range(1_000_000))
    ),
    "a simulator without parameters": partial(
        parameters, lambda node, values: values.clear() if node == "/simulator" else None
    ),
    "a parameter nobody knows": _parameter("/pid", "spin", 1.0),
    "an event without a status": lambda run: _added(SAID, _no_status(), run),
    "an event of garbage": lambda run: _added(SAID, b"\0\1\0\0\xff\xff", run),
    "an event that is empty": lambda run: _added(SAID, b"", run),
    "an event that claims 4 GB": lambda run: _added(
        SAID, b"\0\1\0\0" + bytes(8) + b"\xff\xff\xff\x7f" * 9, run
    ),
    "an end of `many` states": lambda run: _added(
        SAID, schemas.event(0, "/simulator", "finished", {"states": "many"}), run
    ),
    "a fall of `up`": lambda run: _added(
        SAID, schemas.event(0, "/simulator", "fell", {"angle": "up", "limit": ""}), run
    ),
    "a change of garbage": lambda run: _added(GIVEN, b"\0\1\0\0\1\2\3\4\5\6\7\xff\xff\xff", run),
    "a change to a text": lambda run: _added(
        GIVEN, schemas.parameter_event(10**8, "/pid", {}, {"kp": "high"}), run
    ),
    "a change far from now": lambda run: _added(
        GIVEN, schemas.parameter_event(FAR_NS, "/pid", {}, {"kp": 1.0}), run
    ),
    "a reset far from now": lambda run: _added(
        SAID, schemas.event(FAR_NS, "/simulator", "reset"), run
    ),
    "one true state of garbage": partial(_garbage, TRUTH, b"\0\1\0\0garbage", lambda i: i == 7),
    "every other true state of garbage": partial(_garbage, TRUTH, b"\xff" * 40, lambda i: i % 2),
    "all true states of garbage": partial(_garbage, TRUTH, b"\xff" * 40, lambda i: True),
    "one command of garbage": partial(_garbage, COMMAND, b"\0\1", lambda i: i == 7),
    "terms of garbage": partial(_garbage, STATE, b"", lambda i: True),
    "true states of another type": partial(_typed, TRUTH, "std_msgs/msg/String"),
    "true states of no type": partial(_typed, TRUTH, ""),
    "parameters of another type": partial(_typed, GIVEN, "std_msgs/msg/String"),
    "big-endian true states": _big_endian,
    "a true state that is NaN": partial(joints, (TRUTH,), _set("position", nan, 5)),
    "a true state that is infinite": partial(joints, (TRUTH,), _set("position", inf, 5)),
    "a true state of 1e300": partial(joints, (TRUTH,), _set("position", 1e300, 5)),
    "a command that is NaN": partial(joints, (COMMAND,), _set("effort", nan, 5)),
    "a measured rate of 1e308": partial(joints, (SEEN,), _set("velocity", 1e308, 5)),
    "all true states NaN": partial(
        joints, (TRUTH,), lambda a, i: a.update({"position": [nan, nan]})
    ),
    **{
        f"a stamp of 2^31 - 1 s in {topic.strip('/')}": partial(
            joints, (topic,), _stamped(lambda ns, i: FAR_NS if i == 20 else ns)
        )
        for topic in (*_EVERY, STATE)
    },
    "stamps before zero": partial(joints, _EVERY, _stamped(lambda ns, i: ns - 2 * 10**9)),
    "equal stamps": partial(joints, _EVERY, _stamped(lambda ns, i: 0)),
    "stamps backwards": partial(joints, _EVERY, _stamped(lambda ns, i: 2 * 10**9 - ns)),
    "stamps off the period": partial(joints, _EVERY, _stamped(lambda ns, i: ns + i * 7)),
    "log times of 2^63 - 1": lambda run: [[row[0], 2**63 - 1, *row[2:]] for row in run.messages],
    "an arm with seven joints": _arm,
    "a controller nobody knows": _unknown_controller,
    "the reverse order": lambda run: run.messages[::-1],
}

FILES: dict[str, Callable[[Path, Path], Path]] = {
    name: partial(edited, change) for name, change in _CHANGES.items()
}
