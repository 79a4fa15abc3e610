"""Consecutive states of an offline run as one table: what CPython and compiled code hand to the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from trunk_control.decide import Output, state_record
from trunk_control.law import Law
from trunk_msgs_util.recording.joint_table import Floats
from trunk_sim.disturbances import Disturbance
from trunk_sim.step import Measurement, Plant, PlantStatus

from .loop import Decision

# Columns of the table. A position or velocity has two: hip, trunk.
POSITION, VELOCITY = slice(0, 2), slice(2, 4)  # true
SEEN_POSITION, SEEN_VELOCITY = slice(4, 6), slice(6, 8)  # measured
APPLIED = 8  # N m, over the previous step
ACTING, OFFSET = slice(9, 11), slice(11, 13)  # disturbance: N and N m; m and rad
EFFORT = 13  # N m, the command
FRESH = 14  # 1.0 where the law was updated: the terms are those of this update
REFERENCE = 15  # rad, of the controller that answers
SEEN_APPLIED = 16  # N m, over the step before the one that is measured
ACTIVE = 17  # which controllers are active: the sum of 2^i over their places i
FALLEN = 18  # 1.0 from the state on in which the trunk has fallen
TERMS = 19  # and following: a law's record of an update, by `Law.record_names`

# A signal waits for the end of a stretch at most; a stretch also fits into the cache.
_LONGEST = 4096  # states
_SUBSTEPS = 1 << 18  # Runge-Kutta steps


class States(NamedTuple):
    """N consecutive states, and the rows in which something irregular happens."""

    first: int  # the first one's index
    table: Floats  # [N, columns]
    acts: list[tuple[int, str]]  # which controller answers from a row on; empty: none
    turned: list[tuple[int, str, bool]]  # made active or inactive by the schedule, before the row
    falls: list[int]  # the trunk fell in these rows
    term_names: Mapping[str, tuple[str, ...]]  # the names of each controller's terms

    def answers(self) -> Iterator[tuple[str, slice]]:
        """Yield which controller answers in which rows; rows without one are left out."""
        ends = [row for row, _ in self.acts[1:]] + [len(self.table)]
        for (begin, name), end in zip(self.acts, ends, strict=True):
            if name:
                yield name, slice(begin, end)

    def acting(self, row: int) -> str:
        """Return the controller that answers the state of a row; empty: none."""
        return [name for since, name in self.acts if since <= row][-1]


def longest(substeps: int) -> int:
    """Return how many states are computed at a time."""
    return max(1, min(_LONGEST, _SUBSTEPS // substeps))


def keep_states(
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
    """Write a state into a row of ``out``, except its terms. Compiles unchanged."""
    state = trunk.state
    out[row, 0], out[row, 1], out[row, 2], out[row, 3] = (
        state.x,
        state.theta,
        state.x_dot,
        state.theta_dot,
    )
    out[row, 4], out[row, 5] = measured.x, measured.theta
    out[row, 6], out[row, 7] = measured.x_dot, measured.theta_dot
    out[row, 8] = trunk.effort
    out[row, 9], out[row, 10] = acting.hip_force, acting.trunk_torque
    out[row, 11], out[row, 12] = acting.hip_offset, acting.trunk_offset
    out[row, 13] = acted.effort
    out[row, 14] = 1.0 if acted.updated else 0.0
    out[row, 15] = acted.reference
    out[row, 16] = measured_torque
    out[row, 17] = acted.active
    out[row, 18] = 1.0 if trunk.fallen else 0.0


def write_terms(law: Law) -> Callable[[Floats, int, Output, Measurement], None]:
    """Return the function that writes the terms of a law's update into a row of ``out``."""

    def write_down(out: Floats, row: int, answer: Output, measured: Measurement) -> None:
        said = state_record(answer, measured.theta)
        for i in range(len(said)):
            out[row, TERMS + i] = said[i]

    return write_down
