"""The cells of a block of lanes: which row holds what, and how a lane's records are read from them."""

from __future__ import annotations

from trunk_control.decide import Reading
from trunk_control.law import Hip, Sample
from trunk_control.pid_family import PidState
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState

from ..analysis.sums import Sums
from .columns import LANES

STATE = 0  # of the plant, 4
SEEN = 4  # the state that the sensors see, 4
ACTING = 8  # the disturbance, 4
NOISE = 12  # samples, 2
WANTED = 14  # the reference now
REFERENCE = 15  # that of the last update, whose sample the next four rows have
SAMPLE = 16  # measurement, rate, the hip's position and rate
MEMORY = 20  # of the law, 5: its state but for ``started``
TORQUE = 25
LEFT = 26  # 1.0 in a lane that has left the regular course
TURNING = 27  # all that turns the trunk over a period
INPUTS = 28  # what a law's tables are looked up by, 2
SUMS = 30
PARAMETERS = SUMS + len(
    Sums._fields
)  # of the run, as many as it has; then the cell of a law's tables


def state_at(cells: Floats, row: int, lane: int) -> PlantState:
    """Return the plant's state in four rows."""
    return PlantState(
        cells[row * LANES + lane],
        cells[(row + 1) * LANES + lane],
        cells[(row + 2) * LANES + lane],
        cells[(row + 3) * LANES + lane],
    )


def keep_state(state: PlantState, cells: Floats, lane: int) -> None:
    """Write the plant's state."""
    cells[STATE * LANES + lane] = state.x
    cells[(STATE + 1) * LANES + lane] = state.theta
    cells[(STATE + 2) * LANES + lane] = state.x_dot
    cells[(STATE + 3) * LANES + lane] = state.theta_dot


def acting_at(cells: Floats, lane: int) -> Disturbance:
    """Return the disturbance."""
    return Disturbance(
        cells[ACTING * LANES + lane],
        cells[(ACTING + 1) * LANES + lane],
        cells[(ACTING + 2) * LANES + lane],
        cells[(ACTING + 3) * LANES + lane],
    )


def sample_at(cells: Floats, lane: int, dt: float) -> Sample:
    """Return the law's sample."""
    return Sample(
        cells[REFERENCE * LANES + lane],
        cells[SAMPLE * LANES + lane],
        cells[(SAMPLE + 1) * LANES + lane],
        dt,
        Hip(cells[(SAMPLE + 2) * LANES + lane], cells[(SAMPLE + 3) * LANES + lane]),
    )


def keep_sample(reading: Reading, reference: float, cells: Floats, lane: int) -> None:
    """Write what a law's sample consists of."""
    cells[REFERENCE * LANES + lane] = reference
    cells[SAMPLE * LANES + lane] = reading.position
    cells[(SAMPLE + 1) * LANES + lane] = reading.velocity
    cells[(SAMPLE + 2) * LANES + lane] = reading.hip.position
    cells[(SAMPLE + 3) * LANES + lane] = reading.hip.velocity


def memory_at(cells: Floats, lane: int, started: bool) -> PidState:
    """Return the law's state."""
    return PidState(
        cells[MEMORY * LANES + lane],
        cells[(MEMORY + 1) * LANES + lane],
        cells[(MEMORY + 2) * LANES + lane],
        cells[(MEMORY + 3) * LANES + lane],
        cells[(MEMORY + 4) * LANES + lane],
        started,
    )


def keep_memory(memory: PidState, cells: Floats, lane: int) -> None:
    """Write the law's state."""
    cells[MEMORY * LANES + lane] = memory.integral
    cells[(MEMORY + 1) * LANES + lane] = memory.error
    cells[(MEMORY + 2) * LANES + lane] = memory.measurement
    cells[(MEMORY + 3) * LANES + lane] = memory.derivative
    cells[(MEMORY + 4) * LANES + lane] = memory.effort


def sums_at(cells: Floats, lane: int) -> Sums:
    """Return the sums so far."""
    return Sums(
        cells[SUMS * LANES + lane],
        cells[(SUMS + 1) * LANES + lane],
        cells[(SUMS + 2) * LANES + lane],
        cells[(SUMS + 3) * LANES + lane],
        cells[(SUMS + 4) * LANES + lane],
        cells[(SUMS + 5) * LANES + lane],
        cells[(SUMS + 6) * LANES + lane],
        cells[(SUMS + 7) * LANES + lane],
        cells[(SUMS + 8) * LANES + lane],
        cells[(SUMS + 9) * LANES + lane],
        cells[(SUMS + 10) * LANES + lane],
        cells[(SUMS + 11) * LANES + lane],
        cells[(SUMS + 12) * LANES + lane],
        cells[(SUMS + 13) * LANES + lane],
        cells[(SUMS + 14) * LANES + lane],
        cells[(SUMS + 15) * LANES + lane],
        cells[(SUMS + 16) * LANES + lane],
        cells[(SUMS + 17) * LANES + lane],
        cells[(SUMS + 18) * LANES + lane],
    )


def keep_sums(sums: Sums, cells: Floats, lane: int) -> None:
    """Write the sums."""
    cells[SUMS * LANES + lane] = sums.t
    cells[(SUMS + 1) * LANES + lane] = sums.error
    cells[(SUMS + 2) * LANES + lane] = sums.torque
    cells[(SUMS + 3) * LANES + lane] = sums.iae
    cells[(SUMS + 4) * LANES + lane] = sums.ise
    cells[(SUMS + 5) * LANES + lane] = sums.itae
    cells[(SUMS + 6) * LANES + lane] = sums.effort
    cells[(SUMS + 7) * LANES + lane] = sums.peak_torque
    cells[(SUMS + 8) * LANES + lane] = sums.lowest
    cells[(SUMS + 9) * LANES + lane] = sums.highest
    cells[(SUMS + 10) * LANES + lane] = sums.level
    cells[(SUMS + 11) * LANES + lane] = sums.level_since
    cells[(SUMS + 12) * LANES + lane] = sums.level_from
    cells[(SUMS + 13) * LANES + lane] = sums.level_lowest
    cells[(SUMS + 14) * LANES + lane] = sums.level_highest
    cells[(SUMS + 15) * LANES + lane] = sums.settled_at
    cells[(SUMS + 16) * LANES + lane] = sums.steady_rows
    cells[(SUMS + 17) * LANES + lane] = sums.steady_sum
    cells[(SUMS + 18) * LANES + lane] = sums.steady_squares
