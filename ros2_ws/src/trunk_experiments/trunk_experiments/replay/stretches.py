"""Quickly skips long stretches of a recorded run whose recomputed values equal the recorded ones.

Each function composes `sense`, `decide`, `act` or `disturbance_at` over the record's columns and returns
where it stopped: at the end of the stretch, or at the first step in which something differs or is
missing. That step is left to the replay, which examines it in detail. Numba compiles these functions.

Pure: functions of arrays, numbers and named tuples.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any, NamedTuple

from trunk_control.computed_torque import Hip
from trunk_control.decide import Memory, Reading, Setting, decide, state_record
from trunk_control.law import Law
from trunk_control.laws import law_named
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.plant import PlantState
from trunk_sim.step import Plant, SensorParameters, Trunk, moved, sense, torque_of

from .bits import alike

LONGEST = 50_000  # rows at a time: compiled code cannot be interrupted


class PlantRecord(NamedTuple):
    """A run's record of the plant, one row per recorded true state; NaN where a message is missing."""

    truth: Floats  # [N, 6]: positions, velocities, efforts of hip and trunk
    measured: Floats  # [N, 6], the same
    command: Floats  # [N], N m
    disturbance: Floats  # [N, 4], in the order of the channels
    fell: Integers  # [N], 1 where the trunk fell by the events
    noise: Floats  # [N, 2], standard normal samples
    seen: Integers  # [N], the row whose reading was seen


def plant_stretch(
    first: int,
    last: int,
    trunk: Trunk,
    falls: bool,
    remembered: int,
    changed: int,
    delay_steps: int,
    plant: Plant,
    sensor: SensorParameters,
    record: PlantRecord,
    applied: bool,
) -> tuple[int, Trunk, bool]:
    """Return the first row in [first, last] that is not skipped, and trunk and fall there.

    ``remembered`` is the oldest row that the sensors' delay may reach back to, ``changed`` the first one in
    which they were as they are now. ``applied``, in real time: the record's torques are what the actuator
    made of the commands, and a step is skipped only if it leads to the next state, which the record then has.
    """
    for row in range(first, last):
        state = trunk.state
        truth, seen = record.truth, record.measured
        if not (
            alike(truth[row, 0], state.x)
            and alike(truth[row, 1], state.theta)
            and alike(truth[row, 2], state.x_dot)
            and alike(truth[row, 3], state.theta_dot)
            and alike(truth[row, 4], 0.0)
            and alike(truth[row, 5], trunk.effort)
            and falls == (record.fell[row] == 1)
        ):
            return row, trunk, falls
        acting = Disturbance(
            record.disturbance[row, 0],
            record.disturbance[row, 1],
            record.disturbance[row, 2],
            record.disturbance[row, 3],
        )
        source = record.seen[row]
        if source != row and source < changed:
            return row, trunk, falls
        old = max(source - delay_steps, remembered)
        delayed = PlantState(truth[old, 0], truth[old, 1], truth[old, 2], truth[old, 3])
        offsets = Disturbance(
            record.disturbance[source, 0],
            record.disturbance[source, 1],
            record.disturbance[source, 2],
            record.disturbance[source, 3],
        )
        computed = sense(delayed, offsets, record.noise[source, 0], record.noise[source, 1], sensor)
        if not (
            alike(seen[row, 0], computed.x)
            and alike(seen[row, 1], computed.theta)
            and alike(seen[row, 2], computed.x_dot)
            and alike(seen[row, 3], computed.theta_dot)
            and alike(seen[row, 4], 0.0)
            and alike(seen[row, 5], truth[source, 5])
        ):
            return row, trunk, falls
        command = record.command[row]
        if command - command != 0.0:
            return row, trunk, falls
        torque = command if applied else torque_of(trunk.effort, command, plant)
        after = moved(trunk, torque, acting, plant)
        if after.diverged:
            return row, trunk, falls
        if applied and not (
            alike(truth[row + 1, 0], after.state.x)
            and alike(truth[row + 1, 1], after.state.theta)
            and alike(truth[row + 1, 2], after.state.x_dot)
            and alike(truth[row + 1, 3], after.state.theta_dot)
        ):
            return row, trunk, falls  # another disturbance may have acted
        falls = after.fallen and not trunk.fallen
        trunk = after
    return last, trunk, falls


class CommandRecord(NamedTuple):
    """A run's record of a controller, one row per command; rows of states and terms are -1 for none."""

    stamp_ns: Integers  # [N]
    command: Floats  # [N], N m
    state_row: Integers  # [N]
    terms_row: Integers  # [N]
    states: Floats  # [M, 5]: angle, rate, hip's position and velocity, torque that acts
    terms: Floats  # [L, K], as `Law.record_names`


def commands_stretch_of(law: Law) -> Callable[..., tuple[int, Memory]]:
    """Return the function that skips the commands of a controller with this law."""
    update, take_over = law.update, law.take_over

    def commands_stretch(
        first: int,
        last: int,
        memory: Memory,
        setting: Setting,
        constants: Any,
        record: CommandRecord,
    ) -> tuple[int, Memory]:
        """Return the first row in [first, last] that is not skipped, and the memory before it."""
        for row in range(first, last):
            at, told = record.state_row[row], record.terms_row[row]
            if at < 0:
                return row, memory
            states = record.states
            reference = record.terms[told, 0] if told >= 0 else 0.0
            reading = Reading(
                record.stamp_ns[row],
                states[at, 0],
                states[at, 1],
                Hip(states[at, 2], states[at, 3]),
                states[at, 4],
                told >= 0,
                reference,
            )
            after, answer = decide(memory, reading, setting, constants, update, take_over)
            if not (answer.active and alike(answer.effort, record.command[row])):
                return row, memory
            if answer.fresh != (told >= 0):
                return row, memory
            if answer.fresh:
                said = state_record(answer, states[at, 0])
                for i in range(len(said)):
                    if not alike(said[i], record.terms[told, i]):
                        return row, memory
            memory = after
        return last, memory

    name = f"commands_stretch_{update.__module__}"
    commands_stretch.__name__ = commands_stretch.__qualname__ = name
    return commands_stretch


def disturbances_stretch(
    first: int, last: int, signals: Signals, stamp_ns: Integers, record: Floats
) -> int:
    """Return the first row of ``record`` [N, 4] in [first, last] that differs from the signals."""
    for row in range(first, last):
        acting = disturbance_at(stamp_ns[row], signals)
        if not (
            alike(acting.hip_force, record[row, 0])
            and alike(acting.trunk_torque, record[row, 1])
            and alike(acting.hip_offset, record[row, 2])
            and alike(acting.trunk_offset, record[row, 3])
        ):
            return row
    return last


@cache
def available() -> bool:
    """Return True if there is a compiler; without numba the replay goes step by step."""
    return find_spec("numba") is not None


@cache
def compiled_plant() -> Callable[..., tuple[int, Trunk, bool]]:
    """Return `plant_stretch`, compiled."""
    from trunk_msgs_util.compiled import compiled

    return compiled(plant_stretch)


@cache
def compiled_commands(law: str) -> Callable[..., tuple[int, Memory]]:
    """Return the named law's `commands_stretch_of`, compiled."""
    from trunk_msgs_util.compiled import compiled_or_plain

    return compiled_or_plain(commands_stretch_of(law_named(law)), lambda reason: None)


@cache
def compiled_disturbances() -> Callable[..., int]:
    """Return `disturbances_stretch`, compiled."""
    from trunk_msgs_util.compiled import compiled

    return compiled(disturbances_stretch)
