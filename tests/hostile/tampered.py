"""Recordings of a run that were changed: something left out, put in, or renamed, as in other robots' bags."""

from collections.abc import Callable, Sequence
from functools import partial
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Schema
from ros2_ws.src.trunk_recording.test.mcap_files import NONE, Content, content, stamp_of, write_file
from rosbags.typesys import Stores, get_typestore

from trunk_core.samples import JointSample
from trunk_core.topics import DIAGNOSTIC_ARRAY_TYPE, JOINT_STATE_TYPE
from trunk_recording import schemas
from trunk_recording.cdr import JointStateLayout

from ..tampering import edits
from ..tampering.edits import at, dropped, each, every, fields, nth, on, renamed, stamp_ns, to, tree

TRUTH, SEEN, COMMAND, DISTURBANCE = edits.TRUTH, edits.MEASURED, edits.COMMANDS, edits.DISTURBANCE
GIVEN, SAID, STATE = edits.PARAMETERS, edits.EVENTS, edits.STATES[0]
CONTROLLER = "/fuzzy_pid"
FAR_NS = (2**31 - 1) * 10**9
NO = to(np.zeros(0))

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


def joints(topics: Sequence[str], alter: edits.Alter, pick: edits.Pick = every) -> Change:
    """Return a change of JointState messages as trees."""
    steps = [on(topic, pick, fields(alter, log_time=False)) for topic in topics]
    return lambda run: [step(run) for step in steps] and None


def stamped(topics: Sequence[str], ns: Callable[[int], int], pick: edits.Pick = every) -> Change:
    def stamp(time: Any) -> Any:
        sec, nanosec = divmod(ns(stamp_of(time)), 10**9)
        return schemas.build(time.__msgtype__, sec=sec, nanosec=nanosec)

    return joints(topics, at("header.stamp", stamp), pick)


def named(*names: str) -> edits.Alter:
    return at("name", to(list(names)))


def filled(quantity: str, value: float) -> edits.Alter:
    return at(quantity, lambda values: np.full(len(values), value))


def garbage(topic: str, data: bytes, pick: edits.Pick = every) -> Change:
    return on(topic, pick, each(lambda row: row.__setitem__(2, data)))


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
    event = schemas.deserialize(DIAGNOSTIC_ARRAY_TYPE, schemas.event(0, "", ""))
    return schemas.serialize(DIAGNOSTIC_ARRAY_TYPE, at("status", to([]))(event))


def _typed(topic: str, kind: str, run: Content) -> None:
    number = max(run.schemas) + 1
    run.schemas[number] = Schema(number, b"", "ros2msg", kind)
    run.channels[topic].schema_id = number


def _alternating(run: Content) -> None:
    for first in (0, 1):
        one = at(
            f"name {edits.QUANTITIES}", lambda part, first=first: part[first : first + 1].copy()
        )
        joints((TRUTH, SEEN), one, lambda messages, first=first: messages[first::2])(run)


def _off_the_period(run: Content) -> None:
    for topic in _EVERY:
        for i in range(len(run.of(topic))):
            stamped((topic,), lambda ns, i=i: ns + i * 7, nth(i))(run)


def _big_endian(run: Content) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    for row in run.of(TRUTH):
        row[2] = bytes(store.serialize_cdr(tree(row), JOINT_STATE_TYPE, little_endian=False))


def _not_utf8(run: Content) -> None:
    for row in run.of(TRUTH):
        row[2] = row[2].replace(b"hip\0", b"\xff\xfe\xc3\0").replace(b"trunk\0", b"trunk\xc3\0")


def _arm(topic: str, run: Content) -> Rows:
    names = [f"joint_{i}" for i in range(7)]
    return [
        [topic, k * 10**7, joint_state(k * 10**7, names, [0.1 * k] * 7), 0, 0] for k in range(300)
    ]


def _first_of_each(but: str, run: Content) -> Rows:
    first = {row[0]: row for row in reversed(run.messages)}
    return [row for row in run.messages if row[0] == but or row is first[row[0]]]


_EVERY = (TRUTH, SEEN, COMMAND, DISTURBANCE)
_CHANGES: dict[str, Change] = {
    **{
        f"{topic.strip('/').replace('/', '.')} without {quantity}": joints(
            (topic,), at(quantity, NO)
        )
        for topic in (SEEN, TRUTH)
        for quantity in edits.QUANTITIES.split()
    },
    "true states without values": joints((TRUTH,), at(edits.QUANTITIES, NO)),
    "commands without effort": joints((COMMAND,), at("effort", NO)),
    "commands to two joints": joints(
        (COMMAND,), lambda v: at("effort", to(np.array([0.0, 1.0])))(named("hip", "trunk")(v))
    ),
    "terms without position": joints((STATE,), at("position", NO)),
    "terms of other names": joints(
        (STATE,), lambda v: at("position", to(np.array([1.0, 2.0])))(named("a", "b")(v))
    ),
    "disturbance without effort": joints((DISTURBANCE,), at("effort", NO)),
    "disturbance without position": joints((DISTURBANCE,), at("position", NO)),
    **{
        f"one joint in {topic.strip('/')}": joints(
            (topic,), at(f"name {edits.QUANTITIES}", lambda part: part[:1].copy())
        )
        for topic in (TRUTH, SEEN, DISTURBANCE)
    },
    "measured joints renamed": joints((SEEN,), named("a", "b")),
    "true joints renamed": joints((TRUTH,), named("a", "b")),
    "command's joint renamed": joints((COMMAND,), named("elbow")),
    "all joints renamed": joints(_EVERY, at("name", lambda names: ["a", "b"][: len(names)])),
    "true joints swapped": joints((TRUTH,), named("trunk", "hip")),
    "both joints of one name": joints((TRUTH, SEEN), named("trunk", "trunk")),
    "joints without a name": joints((TRUTH,), named("", "")),
    "names that are not UTF-8": _not_utf8,
    "more names than values": joints((TRUTH,), named("hip", "trunk", "knee")),
    "no names at all": joints((TRUTH,), named()),
    "three joints": joints(
        (TRUTH, SEEN),
        lambda v: at(edits.QUANTITIES, lambda q: np.append(q, q[:1]))(
            named("hip", "trunk", "knee")(v)
        ),
    ),
    "one joint a message": _alternating,
    **{
        f"no {topic.strip('/')}": on(topic, every, dropped)
        for topic in (*_EVERY, STATE, GIVEN, SAID)
    },
    **{
        f"nothing but {topic.strip('/')}": lambda run, topic=topic: run.of(topic)
        for topic in (TRUTH, SEEN, COMMAND, STATE, GIVEN)
    },
    "no messages at all": lambda run: run.messages.clear(),
    "the first message of each topic": partial(_first_of_each, ""),
    "one state, all parameters": partial(_first_of_each, GIVEN),
    "one message of seven missing": lambda run: (
        [on(topic, lambda m: m[3::7], dropped)(run) for topic in (*_EVERY, STATE)] and None
    ),
    "the first terms missing": on(STATE, lambda m: m[:101], dropped),
    "only the first state": lambda run: [
        row for row in run.messages if row[0] not in (*_EVERY, STATE) or stamp_ns(tree(row)) == 0
    ],
    "a negative mass": _parameter("/simulator", "plant.hip_mass", -1.0),
    "another joint parameter": _parameter(CONTROLLER, "joint", "elbow"),
    "another hip parameter": _parameter(CONTROLLER, "hip_joint", "knee"),
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
    **{
        f"no parameters of {name}": partial(
            parameters, lambda node, values, name=name: values.clear() if node == name else None
        )
        for name in ("/simulator", CONTROLLER, DISTURBANCE)
    },
    "a parameter nobody knows": _parameter(CONTROLLER, "spin", 1.0),
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
        GIVEN, schemas.parameter_event(10**8, CONTROLLER, {}, {"kp": "high"}), run
    ),
    "a change far from now": lambda run: _added(
        GIVEN, schemas.parameter_event(FAR_NS, CONTROLLER, {}, {"kp": 1.0}), run
    ),
    "a reset far from now": lambda run: _added(
        SAID, schemas.event(FAR_NS, "/simulator", "reset"), run
    ),
    "one true state of garbage": garbage(TRUTH, b"\0\1\0\0garbage", nth(7)),
    "every other true state of garbage": garbage(TRUTH, b"\xff" * 40, lambda m: m[1::2]),
    "all true states of garbage": garbage(TRUTH, b"\xff" * 40),
    "one command of garbage": garbage(COMMAND, b"\0\1", nth(7)),
    "terms of garbage": garbage(STATE, b""),
    "true states of another type": partial(_typed, TRUTH, "std_msgs/msg/String"),
    "true states of no type": partial(_typed, TRUTH, ""),
    "parameters of another type": partial(_typed, GIVEN, "std_msgs/msg/String"),
    "big-endian true states": _big_endian,
    "a true state that is NaN": joints((TRUTH,), filled("position", nan), nth(5)),
    "a true state that is infinite": joints((TRUTH,), filled("position", inf), nth(5)),
    "a true state of 1e300": joints((TRUTH,), filled("position", 1e300), nth(5)),
    "a command that is NaN": joints((COMMAND,), filled("effort", nan), nth(5)),
    "a measured rate of 1e308": joints((SEEN,), filled("velocity", 1e308), nth(5)),
    "all true states NaN": joints((TRUTH,), filled("position", nan)),
    **{
        f"a stamp of 2^31 - 1 s in {topic.strip('/')}": stamped((topic,), to(FAR_NS), nth(20))
        for topic in (*_EVERY, STATE)
    },
    "stamps before zero": stamped(_EVERY, lambda ns: ns - 2 * 10**9),
    "equal stamps": stamped(_EVERY, to(0)),
    "stamps backwards": stamped(_EVERY, lambda ns: 2 * 10**9 - ns),
    "stamps off the period": _off_the_period,
    "log times of 2^63 - 1": lambda run: [[row[0], 2**63 - 1, *row[2:]] for row in run.messages],
    **{
        f"an arm with seven joints on {topic.strip('/')}": partial(_arm, topic)
        for topic in (SEEN, TRUTH, COMMAND, STATE)
    },
    "a controller nobody knows": partial(
        renamed, lambda name: name.replace(STATE, "/strange/state")
    ),
    "the reverse order": lambda run: run.messages[::-1],
}

FILES: dict[str, Callable[[Path, Path], Path]] = {
    name: partial(edited, change) for name, change in _CHANGES.items()
}
