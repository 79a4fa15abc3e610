"""What a lab computes besides the loop: metrics of its table, and which rules fire; exported as C."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from trunk_control.fuzzy import fired_at
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import seconds
from trunk_sim.disturbances import Disturbance
from trunk_sim.step import Measurement, Plant, PlantStatus, torque_of

from ..analysis.metrics import Sums, with_row
from ..runs.loop import Decision, Keep
from ..runs.states import FRESH, REFERENCE, keep_states

# Columns of the table, up to the terms: those of `runs.states`.
NAMES = (
    *("x", "theta", "x_dot", "theta_dot"),
    *("seen_x", "seen_theta", "seen_x_dot", "seen_theta_dot"),
    *("torque", "hip_force", "trunk_torque", "hip_offset", "trunk_offset"),
    *("command", "fresh", "reference", "seen_torque", "active", "fallen"),
)
THETA = NAMES.index("theta")


class Measured(NamedTuple):
    """The sums of a run's metrics so far, and the reference of the last update, rad."""

    sums: Sums
    reference: float


def keep_with_drive(column: int) -> Keep:
    """Return `keep_states` that also writes the torque over the step from the state, N m, into a column."""

    def keep(
        out: Floats,
        row: int,
        trunk: PlantStatus,
        acting: Disturbance,
        measured: Measurement,
        measured_torque: float,
        acted: Decision,
        effort: float,
        plant: Plant,
    ) -> None:
        keep_states(out, row, trunk, acting, measured, measured_torque, acted, effort, plant)
        out[row, column] = torque_of(trunk.effort, effort, plant)

    return keep


def with_rows(
    before: Measured,
    first: int,
    count: int,
    period_ns: int,
    steady: float,
    drive: int,
    out: Floats,
) -> Measured:
    """Return the sums with ``count`` more rows of a table [N, columns]; the first is state ``first``.

    The steady state begins at ``steady`` s; column ``drive`` has the torque over the step from a state, N m.
    """
    sums, reference = before.sums, before.reference
    for row in range(count):
        if out[row, FRESH] == 1.0:
            reference = float(out[row, REFERENCE])
        sums = with_row(
            sums,
            seconds((first + row) * period_ns),
            float(out[row, THETA]),
            reference,
            float(out[row, drive]),
            steady,
        )
    return Measured(sums, reference)


class Fired(NamedTuple):
    """Row and column of the first of the four rules that fire, and their weights."""

    row: float
    column: float
    w00: float
    w01: float
    w10: float
    w11: float


def rules_at(
    error: float, rate: float, error_peaks: Sequence[float], rate_peaks: Sequence[float]
) -> Fired:
    """Return the rules that fire at e [rad] and e_dot [rad/s]; for display."""
    rules = fired_at(error, rate, error_peaks, rate_peaks)
    return Fired(
        float(rules[0].row),
        float(rules[0].column),
        rules[0].weight,
        rules[1].weight,
        rules[2].weight,
        rules[3].weight,
    )
