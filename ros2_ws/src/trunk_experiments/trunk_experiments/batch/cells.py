"""The cells of a block of lanes: which row holds what, and how a lane's records are read from them."""

from __future__ import annotations

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
TOTAL_TORQUE = 27  # N m, on the trunk over a period
INPUTS = 28  # what a law's tables are looked up by, 2
SUMS = 30
PARAMETERS = SUMS + len(
    Sums._fields
)  # of the run, as many as it has; then the cell of a law's tables


def four(cells: Floats, row: int, lane: int) -> tuple[float, float, float, float]:
    """Return a lane's numbers in four rows."""
    at = row * LANES + lane
    return cells[at], cells[at + LANES], cells[at + 2 * LANES], cells[at + 3 * LANES]


def keep_four(numbers: tuple[float, ...], row: int, cells: Floats, lane: int) -> None:
    """Write a lane's four numbers into the rows from ``row`` on."""
    at = row * LANES + lane
    cells[at], cells[at + LANES] = numbers[0], numbers[1]
    cells[at + 2 * LANES], cells[at + 3 * LANES] = numbers[2], numbers[3]


def keep_memory(memory: PidState, cells: Floats, lane: int) -> None:
    """Write the law's state."""
    keep_four(memory[:4], MEMORY, cells, lane)
    cells[(MEMORY + 4) * LANES + lane] = memory.effort


def keep_sums(sums: Sums, cells: Floats, lane: int) -> None:
    """Write the sums."""
    keep_four(sums[:4], SUMS, cells, lane)
    keep_four(sums[4:8], SUMS + 4, cells, lane)
    keep_four(sums[8:12], SUMS + 8, cells, lane)
    keep_four(sums[12:16], SUMS + 12, cells, lane)
    cells[(SUMS + 16) * LANES + lane] = sums.steady_rows
    cells[(SUMS + 17) * LANES + lane] = sums.steady_sum
    cells[(SUMS + 18) * LANES + lane] = sums.steady_squares


def state_at(cells: Floats, row: int, lane: int) -> PlantState:
    """Return the plant's state in four rows."""
    return PlantState(*four(cells, row, lane))


def acting_at(cells: Floats, lane: int) -> Disturbance:
    """Return the disturbance."""
    return Disturbance(*four(cells, ACTING, lane))


def sample_at(cells: Floats, lane: int, dt: float) -> Sample:
    """Return the law's sample."""
    measurement, rate, hip, hip_rate = four(cells, SAMPLE, lane)
    return Sample(cells[REFERENCE * LANES + lane], measurement, rate, dt, Hip(hip, hip_rate))


def memory_at(cells: Floats, lane: int, started: bool) -> PidState:
    """Return the law's state."""
    effort = cells[(MEMORY + 4) * LANES + lane]
    return PidState(*four(cells, MEMORY, lane), effort, started)


def sums_at(cells: Floats, lane: int) -> Sums:
    """Return the sums so far."""
    return Sums(
        *four(cells, SUMS, lane),
        *four(cells, SUMS + 4, lane),
        *four(cells, SUMS + 8, lane),
        *four(cells, SUMS + 12, lane),
        cells[(SUMS + 16) * LANES + lane],
        cells[(SUMS + 17) * LANES + lane],
        cells[(SUMS + 18) * LANES + lane],
    )
