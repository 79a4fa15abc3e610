"""Recordings of real-time runs, made without processes: with sources, and with what acted on the plant."""

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_core import topics
from trunk_core.parameters.declarations import declarations
from trunk_core.topics import Event
from trunk_msgs_util.completeness import OF_STATES
from trunk_msgs_util.source import NO_SOURCE
from trunk_recording.reader import Recording
from trunk_recording.schemas import (
    deserialize,
    event,
    parameter_event,
    parse_event,
    parse_parameter_event,
    serialize,
)
from trunk_runs.loop import disturbance_source, states_of
from trunk_runs.nodes import NODES
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan
from trunk_runs.timeline import GivenInputs

EVENTS, PARAMETERS, INPUTS = "/run/events", "/run/parameters", f"/{topics.PLANT_INPUTS}"
COMMAND = "/effort_command"
NOTHING_GIVEN = GivenInputs(
    np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, np.int64), {}, np.zeros(0, np.int64), {}
)

Late = int | NDArray[Any]  # steps, of all or of each state


def source_of(node: str, process: int = 1) -> str:
    """Return the source of the messages of a node's process."""
    return f"{node}@machine-{process}"


def late_inputs(plan: RunPlan, commands: Late = 0, disturbances: Late = 0) -> GivenInputs:
    """Return what acts if messages come so many steps late, an array: in each state."""
    states, period_ns = states_of(plan), plan.simulator.period_ns
    steps = np.arange(states)
    command = np.maximum.accumulate(steps - commands)
    acting, since = np.zeros((states, 4)), np.full(states, -1)
    if plan.disturbance is not None:
        # The first state waits for its own.
        disturbed = np.maximum(np.maximum.accumulate(steps - disturbances), 0)
        since = disturbed * period_ns
        source = disturbance_source(plan)
        values = np.array([source(k * period_ns) for k in range(states)])
        acting = values[disturbed]
    return GivenInputs(
        np.where(command >= 0, command * period_ns, -1),
        acting,
        since,
        dict.fromkeys(plan.controllers, steps * period_ns),
        np.arange(states + 1) * period_ns,
        {},
    )


def record_real_time(plan: RunPlan, path: Path, inputs: GivenInputs | None = None) -> Recording:
    """Write a plan's run as the nodes do in real time; ``inputs``: what acted, None: each message in time."""
    plan = replace(plan, inputs=inputs or NOTHING_GIVEN)
    source = path.with_suffix(".without_words.mcap")
    record_offline(plan, source)

    def edit(messages: list[list]) -> None:
        name_sources(messages)
        configure(messages, *(name for name in plan.configs if name != "recorder"))
        count(messages)

    written = copied(source, path, edit, ANEW, provenance={"mode": "real_time"})
    source.unlink()
    return written


def name_sources(messages: list[list]) -> None:
    """Name the source of each message, and of what it says is in force."""
    owners = {f"/{topic}": "simulator" for topic in (*OF_STATES, topics.OPERATOR_PUSH)}
    owners[f"/{topics.DISTURBANCE}"] = "disturbance"
    senders: dict[int, str] = {}  # of commands, by stamp
    for message in messages:
        topic, _, data, *_ = message
        if topic.endswith("/state"):
            owner = topic.removeprefix("/").removesuffix("/state")
            senders[stamp_at(data)] = owner
            message[2] = in_frame(data, source_of(owner))
    acting = ""
    for message in messages:
        topic, _, data, *_ = message
        if topic == COMMAND:
            acting = senders.setdefault(stamp_at(data), acting)  # a skipped state has no terms
            message[2] = in_frame(data, source_of(acting))
        elif topic in owners:
            message[2] = in_frame(data, source_of(owners[topic]))
        elif topic == EVENTS:
            said = parse_event(data)
            source = source_of(said.node.removeprefix("/"))
            message[2] = event(
                said.stamp_ns, said.node, said.message, said.values, said.level, source
            )
        elif topic == PARAMETERS:
            said = parse_parameter_event(data)
            kind = said.node.removeprefix("/")
            kinds = {name: d.kind for name, d in declarations(NODES[kind].config).items()}
            message[2] = parameter_event(
                said.stamp_ns, said.node, said.new, said.changed, kinds, source_of(kind)
            )
    for message in messages:
        if message[0] == INPUTS:
            stamp_ns, (command, disturbance) = stamp_at(message[2]), ages_in(message[2])
            sender = source_of(senders[stamp_ns - command]) if command >= 0 else NO_SOURCE
            disturber = source_of("disturbance") if disturbance >= 0 else NO_SOURCE
            message[2] = in_frame(message[2], f"{source_of('simulator')} {sender} {disturber}")


def ages_in(data: bytes) -> tuple[int, int]:
    """Return the age of a command in force, and of a disturbance, ns."""
    command, disturbance, *_ = deserialize(topics.JOINT_STATE_TYPE, data).velocity
    return int(command), int(disturbance)


def configure(messages: list[list], *nodes: str, process: int = 1, at: int = 0) -> None:
    """Say that nodes were configured, before the message with this index."""
    for node in nodes:
        values = {"process": source_of(node, process).partition("@")[2], "kind": node}
        data = event(-1, f"/{node}", Event.CONFIGURED, values, source=source_of(node, process))
        messages.insert(at, [EVENTS, 0, data, 0, 0])
    number(messages)


def count(messages: list[list]) -> None:
    """Say at the end what each process has published, instead of what was said before."""
    messages[:] = [m for m in messages if m[0] != EVENTS or b"published" not in m[2]]
    rows = [deserialize(topics.JOINT_STATE_TYPE, m[2]) for m in messages if m[0] == INPUTS]
    held = [row.velocity[0] >= 0.0 for row in rows[:-1]]
    silent = next((k for k, acts in enumerate(reversed(held)) if acts), len(held))
    for message in messages:
        if message[0] == EVENTS and b"\0finished\0" in message[2]:
            end = parse_event(message[2])
            counts = {"commanded": sum(held), "silent": silent}
            values = {**end.values, **counts}
            message[2] = event(end.stamp_ns, end.node, end.message, values, source=end.source)
    sent: dict[str, Counter[str]] = {}
    for topic, _, data, *_ in messages:
        if topic not in (EVENTS, "/run/parameters"):
            sent.setdefault(frame_of(data).partition(" ")[0], Counter())[topic] += 1
    last = max(message[1] for message in messages)
    for source, counts in sent.items():
        node = source.partition("@")[0]
        data = event(last, f"/{node}", Event.PUBLISHED, counts, source=source)
        messages.append([EVENTS, last, data, last, 0])
    number(messages)


def number(messages: list[list]) -> None:
    """Give the messages of each topic their sequence numbers again."""
    counts: Counter[str] = Counter()
    for message in messages:
        message[4] = counts[message[0]]
        counts[message[0]] += 1


def frame_of(data: bytes) -> str:
    """Return the frame of a message with a header."""
    length = int.from_bytes(data[12:16], "little")
    return data[16 : 16 + length - 1].decode()


def stamp_at(data: bytes) -> int:
    """Return the stamp of a message with a header, ns."""
    sec, nanosec = struct.unpack_from("<iI", data, 4)
    return sec * 1_000_000_000 + nanosec


def in_frame(data: bytes, frame: str) -> bytes:
    """Return a joint state with another frame."""
    return changed(data, lambda message: setattr(message.header, "frame_id", frame))


def changed(data: bytes, edit: Callable[[Any], object]) -> bytes:
    """Return a joint state after an edit of its fields."""
    message = deserialize(topics.JOINT_STATE_TYPE, data)
    edit(message)
    return serialize(topics.JOINT_STATE_TYPE, message)
