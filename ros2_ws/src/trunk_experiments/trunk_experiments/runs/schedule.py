"""What the closed loop takes from outside instead of computing it: links, pushes, references, a recording.

Pure: functions of numbers, arrays and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trunk_msgs_util.recording.joint_table import Floats, Integers
from trunk_sim.disturbances import Disturbance
from trunk_sim.links import Network, Traffic
from trunk_sim.operator_input import Applied, with_operator
from trunk_sim.plant import PlantState
from trunk_sim.step import Measurement, PlantStatus


class Wire(NamedTuple):
    """The links of one run: which messages are in use in each step, and those that may still be used."""

    seen: Integers  # [states], the step whose reading is in use
    used: Integers  # [states], the step whose command is in use, -1: none
    readings: Floats  # [greatest age + 1, 5]: the sensors' readings, and the torque, N m
    commands: Floats  # [greatest age + 1], N m


class Schedule(NamedTuple):
    """What n states take from outside instead of computing it; None, or NaN in a row: it is computed.

    With ``truth``, each state is compared with the record and goes on from it: it has the same bits only if
    the recorded state before it leads to it.
    """

    truth: Floats | None = None  # [n, 5]: x, theta, their rates, torque over the step before
    measured: Floats | None = None  # [n, 5], likewise: what the controllers read
    disturbance: Floats | None = None  # [n, 4], in the order of the channels
    command: Floats | None = None  # [n], in force over the step from the state, N m
    push: Floats | None = None  # [n, 2], an operator's, over the step from the state: N, N m
    reference: Floats | None = (
        None  # [n], the latest one that came by topic, rad; NaN: none has come
    )
    reads: Integers | None = None  # [n, participants], 0 where a participant does not get the state
    stamp_ns: Integers | None = None  # [n], where the states are not those of our plant


NO_WIRE = Wire(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((1, 5)), np.zeros(1))
_NOTHING = Schedule(
    truth=np.zeros((0, 5)),
    measured=np.zeros((0, 5)),
    disturbance=np.zeros((0, 4)),
    command=np.zeros(0),
    push=np.zeros((0, 2)),
    reference=np.zeros(0),
    reads=np.zeros((0, 0), np.int64),
    stamp_ns=np.zeros(0, np.int64),
)


def of_one_type(schedule: Schedule) -> Schedule:
    """Return a schedule as compiled code takes it: an empty array for what is computed."""
    given = {name: value for name, value in schedule._asdict().items() if value is not None}
    return _NOTHING._replace(**given)


def read_by_wire(
    k: int, measured: Measurement, effort: float, wire: Wire | None
) -> tuple[Measurement, float]:
    """Return the controller's reading in step k: the sensors, and the torque over the last step, N m."""
    if wire is None:
        return measured, effort
    if len(wire.seen) == 0:
        return measured, effort
    readings = wire.readings
    here, there = k % len(readings), wire.seen[k] % len(readings)
    readings[here, 0], readings[here, 1] = measured.x, measured.theta
    readings[here, 2], readings[here, 3] = measured.x_dot, measured.theta_dot
    readings[here, 4] = effort
    seen = Measurement(
        float(readings[there, 0]),
        float(readings[there, 1]),
        float(readings[there, 2]),
        float(readings[there, 3]),
    )
    return seen, float(readings[there, 4])


def used_by_wire(k: int, effort: float, wire: Wire | None) -> float:
    """Return the torque that the plant receives in step k, N m, if ``effort`` is in force before the link."""
    if wire is None:
        return effort
    if len(wire.used) == 0:
        return effort
    commands = wire.commands
    commands[k % len(commands)] = effort
    used = wire.used[k]
    return float(commands[used % len(commands)]) if used >= 0 else 0.0


def recorded_trunk(row: int, trunk: PlantStatus, truth: Floats | None) -> PlantStatus:
    """Return the trunk as the record has it; as computed where it has none."""
    if truth is None or len(truth) == 0 or truth[row, 0] != truth[row, 0]:
        return trunk
    state = PlantState(
        float(truth[row, 0]), float(truth[row, 1]), float(truth[row, 2]), float(truth[row, 3])
    )
    return PlantStatus(state, float(truth[row, 4]), trunk.fallen, False)


def recorded_reading(
    row: int, measured: Measurement, effort: float, readings: Floats | None
) -> tuple[Measurement, float]:
    """Return a measured state and the torque in it as the record has them; as computed where it has none."""
    if readings is None or len(readings) == 0 or readings[row, 0] != readings[row, 0]:
        return measured, effort
    seen = Measurement(
        float(readings[row, 0]),
        float(readings[row, 1]),
        float(readings[row, 2]),
        float(readings[row, 3]),
    )
    return seen, float(readings[row, 4])


def recorded_disturbance(row: int, acting: Disturbance, values: Floats | None) -> Disturbance:
    """Return the disturbance in a state: the recorded values, or else the signals' ``acting``."""
    if values is None or len(values) == 0:
        return acting
    return Disturbance(
        float(values[row, 0]), float(values[row, 1]), float(values[row, 2]), float(values[row, 3])
    )


def stamp_at(row: int, regular_ns: int, stamps: Integers | None) -> int:
    """Return a row's stamp, ns."""
    return regular_ns if stamps is None or len(stamps) == 0 else int(stamps[row])


def scheduled(row: int, computed: float, values: Floats | None) -> float:
    """Return a row's value; the computed one where there is none, or NaN."""
    if values is None or len(values) == 0 or values[row] != values[row]:
        return computed
    return float(values[row])


def pushed(row: int, acting: Disturbance, push: Floats | None) -> Disturbance:
    """Return the disturbance with what an operator adds over the step from a row's state."""
    if push is None or len(push) == 0:
        return acting
    return with_operator(acting, Applied(float(push[row, 0]), float(push[row, 1])))


def wire_of(
    network: Network | None, states: int, command_index: Integers | None = None
) -> Wire | None:
    """Return the links of a run with so many states; None where every message arrives at once.

    ``command_index`` [states]: the step whose command is in force before the link, -1: none; None: the step's
    own.
    """
    if network is None and command_index is None:
        return None
    steps: Integers = np.arange(states)
    seen = used = steps
    if network is not None:
        traffic = Traffic(network)
        seen, used = traffic.measurement_steps(states), traffic.command_steps(states)
    if command_index is not None:
        used = np.where(used >= 0, command_index[np.maximum(used, 0)], -1)
    oldest = int((steps - seen).max(initial=0)), int((steps - used)[used >= 0].max(initial=0))
    return Wire(seen, used, np.zeros((oldest[0] + 1, 5)), np.zeros(oldest[1] + 1))
