"""Many episodes of a task side by side: each is a lane, and compiled code steps sixteen at once.

The lanes call the same functions as every run. The cells are those of `batch.lanes`, block after block,
followed by some rows of this module's own. Each lane has its own time: ``steps`` says how many steps into
its episode it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunk_control.limits import Limits, limited
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState
from trunk_msgs_util.compiled import twin, with_arrays
from trunk_msgs_util.recording.joint_table import Floats, Integers
from trunk_msgs_util.text import shortened
from trunk_sim.disturbances import Signals
from trunk_sim.noise import fill, random_bits
from trunk_sim.plant import rk4_step
from trunk_sim.step import (
    Plant,
    SensorParameters,
    beyond_fall,
    finite,
    pruned,
    sense,
    torque_of,
    torque_on,
)

from ..batch.lanes import (
    ACTING,
    LANES,
    NOISE,
    PARAMETERS,
    SEEN,
    STATE,
    acting_at,
    fill_disturbances,
    fill_references,
    keep_four,
    state_at,
)
from ..errors import ActionError, PlanError
from .task import Drawn, Task, lost

ACTION = PARAMETERS  # torque, or kp, ki, kd: 3
COMMAND = ACTION + 3  # N m, within the controller's limits
DT = COMMAND + 1  # s since the last update
PID = DT + 1  # the PID's state, 6
MEASURED = PID + 6  # angle, rate, hip's position and rate: 4
WANTED = MEASURED + 4  # the reference, rad
TORQUE = WANTED + 1  # N m, within the actuator's limits
APPLIED = TORQUE + 1  # N m, over the last period whose state was accepted
BEFORE = APPLIED + 1  # the state before the step, 4
REWARD = BEFORE + 4
FELL = REWARD + 1
DIVERGED = FELL + 1
OVER = DIVERGED + 1
TOTAL_TORQUE = OVER + 1  # N m, the total torque on the trunk over the period
ROWS = TOTAL_TORQUE + 1

OBSERVED = 5  # numbers of an observation


class Course(NamedTuple):
    """What all episodes have in common."""

    plant: Plant
    sensor: SensorParameters
    limits: Limits
    by_gains: bool
    every: int  # the plant's periods in a step
    last: int  # the last state's number
    delay_steps: int
    first_dt: float  # s, of the PID's first update
    dt: float  # s, of all others
    effort_weight: float  # rad^2 / (N m)^2
    lost: float  # rad^2
    fall_stop: bool


class EpisodeSeries(NamedTuple):
    """Inputs over time [episodes, states, numbers]; one episode if all share it, empty if there is none."""

    reference: Floats  # [states]
    acting: Floats  # 4 numbers
    noise: Floats  # 2 numbers


def advance(
    course: Course,
    blocks: Floats,
    steps: Integers,
    series: EpisodeSeries,
    history: Floats,
    actions: Floats,
) -> None:
    """Step every episode: ``every`` periods of the plant under one action, or fewer if the episode ends.

    ``blocks`` [blocks, ROWS LANES]; ``actions`` [episodes, numbers]; ``history`` [delay_steps + 1, 4,
    lanes] has the states of the last periods.
    """
    c = course
    h = c.plant.period / c.plant.substeps
    for block in range(len(blocks)):
        cells, first = blocks[block], block * LANES
        for lane in range(LANES):
            row = min(first + lane, len(actions) - 1)
            for i in range(actions.shape[1]):
                cells[(ACTION + i) * LANES + lane] = actions[row, i]
            cells[DT * LANES + lane] = c.first_dt if steps[first + lane] == 0 else c.dt
            cells[REWARD * LANES + lane] = 0.0
            cells[OVER * LANES + lane] = 0.0
        command(c, cells)
        for _ in range(c.every):
            fetch(series.acting, c, steps, first, ACTING, cells)
            for i in range(4 * LANES):
                cells[BEFORE * LANES + i] = cells[STATE * LANES + i]
            for lane in range(LANES):
                before, wanted = cells[APPLIED * LANES + lane], cells[COMMAND * LANES + lane]
                torque = torque_of(before, wanted, c.plant)
                cells[TORQUE * LANES + lane] = torque
                start = state_at(cells, STATE, lane)
                turning = torque_on(start, torque, acting_at(cells, lane), c.plant)
                cells[TOTAL_TORQUE * LANES + lane] = turning
            for _ in range(c.plant.substeps):
                for lane in range(LANES):
                    acting = acting_at(cells, lane)
                    state = rk4_step(
                        state_at(cells, STATE, lane),
                        acting.hip_force,
                        cells[TOTAL_TORQUE * LANES + lane],
                        h,
                        c.plant.body,
                    )
                    keep_four(state, STATE, cells, lane)
            for lane in range(LANES):
                settle(c, cells, steps, series.reference, history, first, lane)


def command(c: Course, cells: Floats) -> None:
    """Write the commands that a block's actions stand for."""
    if not c.by_gains:
        for lane in range(LANES):
            cells[COMMAND * LANES + lane] = limited(cells[ACTION * LANES + lane], c.limits)
        return
    for lane in range(LANES):
        state, terms = pid_update(
            PidState(
                cells[PID * LANES + lane],
                cells[(PID + 1) * LANES + lane],
                cells[(PID + 2) * LANES + lane],
                cells[(PID + 3) * LANES + lane],
                cells[(PID + 4) * LANES + lane],
                cells[(PID + 5) * LANES + lane] != 0.0,
            ),
            cells[WANTED * LANES + lane],
            cells[MEASURED * LANES + lane],
            cells[(MEASURED + 1) * LANES + lane],
            cells[DT * LANES + lane],
            Gains(
                cells[ACTION * LANES + lane],
                cells[(ACTION + 1) * LANES + lane],
                cells[(ACTION + 2) * LANES + lane],
            ),
            c.limits,
        )
        cells[PID * LANES + lane] = state.integral
        cells[(PID + 1) * LANES + lane] = state.error
        cells[(PID + 2) * LANES + lane] = state.measurement
        cells[(PID + 3) * LANES + lane] = state.derivative
        cells[(PID + 4) * LANES + lane] = state.effort
        cells[(PID + 5) * LANES + lane] = 1.0 if state.started else 0.0
        cells[COMMAND * LANES + lane] = terms.effort


def settle(
    c: Course,
    cells: Floats,
    steps: Integers,
    reference: Floats,
    history: Floats,
    first: int,
    lane: int,
) -> None:
    """Accept or reject an episode's new state and add to its reward; a non-finite state ends the episode."""
    state = state_at(cells, STATE, lane)
    k = steps[first + lane]
    over = cells[OVER * LANES + lane] != 0.0
    if over or k >= c.last or not finite(state):
        for i in range(4):
            cells[(STATE + i) * LANES + lane] = cells[(BEFORE + i) * LANES + lane]
        if not over and k < c.last:
            cells[DIVERGED * LANES + lane] = 1.0
            cells[REWARD * LANES + lane] -= c.plant.period * (c.last - k) * c.lost
        cells[OVER * LANES + lane] = 1.0
        return
    k += 1
    steps[first + lane] = k
    torque = cells[TORQUE * LANES + lane]
    cells[APPLIED * LANES + lane] = torque
    error = reference[k] - state.theta
    reward = -c.plant.period * (error * error + c.effort_weight * torque * torque)
    if c.fall_stop and beyond_fall(state, c.plant):
        cells[FELL * LANES + lane] = 1.0
        cells[OVER * LANES + lane] = 1.0
        reward -= c.plant.period * (c.last - k) * c.lost
    if k == c.last:
        cells[OVER * LANES + lane] = 1.0
    cells[REWARD * LANES + lane] += reward
    if c.delay_steps:
        for i in range(4):
            history[k % len(history), i, first + lane] = cells[(STATE + i) * LANES + lane]


def observe(
    course: Course,
    blocks: Floats,
    steps: Integers,
    series: EpisodeSeries,
    history: Floats,
    out: Floats,
) -> None:
    """Write what a controller sees of every episode [episodes, OBSERVED].

    In order: angle and rate as measured, the reference, the hip's position and rate as measured.
    """
    c = course
    for block in range(len(blocks)):
        cells, first = blocks[block], block * LANES
        for lane in range(LANES):
            cells[WANTED * LANES + lane] = series.reference[min(steps[first + lane], c.last)]
        if c.delay_steps:
            for lane in range(LANES):
                then = max(steps[first + lane] - c.delay_steps, 0) % len(history)
                for i in range(4):
                    cells[(SEEN + i) * LANES + lane] = history[then, i, first + lane]
        else:
            for i in range(4 * LANES):
                cells[SEEN * LANES + i] = cells[STATE * LANES + i]
        fetch(series.acting, c, steps, first, ACTING, cells)
        fetch(series.noise, c, steps, first, NOISE, cells)
        for lane in range(LANES):
            measured = sense(
                state_at(cells, SEEN, lane),
                acting_at(cells, lane),
                cells[NOISE * LANES + lane],
                cells[(NOISE + 1) * LANES + lane],
                c.sensor,
            )
            cells[MEASURED * LANES + lane] = measured.theta
            cells[(MEASURED + 1) * LANES + lane] = measured.theta_dot
            cells[(MEASURED + 2) * LANES + lane] = measured.x
            cells[(MEASURED + 3) * LANES + lane] = measured.x_dot
        for lane in range(min(LANES, len(out) - first)):
            out[first + lane, 0] = cells[MEASURED * LANES + lane]
            out[first + lane, 1] = cells[(MEASURED + 1) * LANES + lane]
            out[first + lane, 2] = cells[WANTED * LANES + lane]
            out[first + lane, 3] = cells[(MEASURED + 2) * LANES + lane]
            out[first + lane, 4] = cells[(MEASURED + 3) * LANES + lane]


def fetch(series: Floats, c: Course, steps: Integers, first: int, row: int, cells: Floats) -> None:
    """Write the values of a series [episodes, states, numbers] at each episode's time, if it has any."""
    if not len(series):
        return
    for lane in range(LANES):
        episode = min(first + lane, len(series) - 1)
        k = min(steps[first + lane], c.last)
        for i in range(series.shape[2]):
            cells[(row + i) * LANES + lane] = series[episode, k, i]


MOST_BYTES = 2 * 1024**3  # of the series of all episodes

Flags = NDArray[np.bool_]


def real_numbers(action: object, shape: tuple[int, ...]) -> Floats:
    """Return an action as numbers of this shape. Raises ActionError for anything else."""
    try:
        given = np.asarray(action)
        taken = None if given.dtype.kind in "cUSmM" else np.ascontiguousarray(given, np.float64)
    except (TypeError, ValueError):  # not numbers, or rows of several lengths
        taken = None
    if taken is None:
        shown = shortened(" ".join(repr(action).split()))
        raise ActionError(f"action: {shown}: give real numbers, an array of shape {shape}")
    if given.shape != shape:
        raise ActionError(f"action: its shape is {given.shape}, it must be {shape}")
    return taken


class Episodes:
    """``count`` episodes, each at its own time. Call `begin` for each before the first `advance`."""

    def __init__(self, task: Task, count: int) -> None:
        """Raise PlanError for more episodes than fit into memory."""
        self.task, self.count = task, count
        common = task.regular.common
        self.course = Course(
            pruned(common.plant),
            common.sensor,
            common.limits,
            task.by_gains,
            common.update_every,
            common.states - 1,
            common.delay_steps,
            common.first_dt,
            common.dt,
            task.effort_weight,
            lost(task),
            common.fall_stop,
        )
        lanes = -(-count // LANES) * LANES
        self._blocks = np.zeros((lanes // LANES, ROWS * LANES))
        self._cells = self._blocks.reshape(-1, ROWS, LANES)
        self.steps = np.zeros(lanes, dtype=np.int64)
        self._history = np.zeros((common.delay_steps + 1, 4, lanes))
        self._noisy = task.regular.seed is not None
        self._series = self._make_series(common.states, common.period_ns)

    def _make_series(self, states: int, period_ns: int) -> EpisodeSeries:
        regular = self.task.regular
        reference = np.empty((states, 1, 1))
        twin(fill_references)(with_arrays(regular.profile), period_ns, 0, reference)
        each = 2 * self._noisy + 4 * self.task.draws_disturbances
        if self.count * states * each * 8 > MOST_BYTES:
            raise PlanError(
                f"{self.count} environments of {states} states: their noise and disturbances need more than "
                f"{MOST_BYTES // 1024**3} GiB; give fewer, or a shorter duration"
            )
        acting: Floats = np.empty((0, states, 4))
        if self.task.draws_disturbances:
            acting = np.empty((self.count, states, 4))
        elif regular.signals is not None:
            acting = self._disturbances(regular.signals)[None]
        noise = np.empty((self.count if self._noisy else 0, states, 2))
        return EpisodeSeries(reference.reshape(-1), acting, noise)

    def _disturbances(self, signals: Signals) -> Floats:
        common = self.task.regular.common
        acting = np.empty((common.states, 4, 1))
        twin(fill_disturbances)(with_arrays(signals), common.period_ns, 0, acting)
        return acting[:, :, 0]

    def begin(self, episode: int, drawn: Drawn) -> None:
        """Begin an episode anew."""
        block, lane = divmod(episode, LANES)
        cells = self._cells[block]
        cells[:, lane] = 0.0
        cells[STATE : STATE + 4, lane] = drawn.initial
        cells[PID + 4, lane] = self.task.regular.effort
        self._history[0, :, episode] = drawn.initial
        self.steps[episode] = 0
        if self._noisy:
            bits = random_bits(drawn.sensor_seed, 0, self.course.last + 1)
            twin(fill)(bits.reshape(-1), self._series.noise[episode].reshape(-1))
        if self.task.draws_disturbances:
            disturbance = self.task.plan_of(drawn).disturbance
            assert disturbance is not None
            self._series.acting[episode] = self._disturbances(disturbance.signals)

    def advance(self, actions: object) -> Floats:
        """Step all episodes under actions [count, numbers]; return the actions as they were used.

        Raises ActionError as `real_numbers` does, and for numbers that are not finite.
        """
        taken = real_numbers(actions, (self.count, len(self.task.low)))
        if not np.isfinite(taken).all():
            episode, i = (int(index) for index in np.argwhere(~np.isfinite(taken))[0])
            raise ActionError(
                f"action: number {i} of environment {episode} is {taken[episode, i]}: it must be finite"
            )
        twin(advance)(self.course, self._blocks, self.steps, self._series, self._history, taken)
        return taken

    def observations(self) -> Floats:
        """Return the controllers' observations now [count, OBSERVED], in a new array."""
        out = np.empty((self.count, OBSERVED))
        twin(observe)(self.course, self._blocks, self.steps, self._series, self._history, out)
        return out

    def _row(self, row: int) -> Floats:
        """Return a row's numbers [count], in a new array."""
        return self._cells[:, row].flatten()[: self.count]

    @property
    def angles(self) -> Floats:
        """The true angles [count], rad."""
        return self._row(STATE + 1)

    @property
    def rewards(self) -> Floats:
        """The rewards of the last step [count]."""
        return self._row(REWARD)

    @property
    def commands(self) -> Floats:
        """The commanded torques of the last step [count], N m, within the controller's limits."""
        return self._row(COMMAND)

    @property
    def torques(self) -> Floats:
        """The torques that were applied over the last period [count], N m."""
        return self._row(APPLIED)

    @property
    def diverged(self) -> Flags:
        """Which episodes' next state would not be finite [count]."""
        return np.not_equal(self._row(DIVERGED), 0.0)

    @property
    def terminated(self) -> Flags:
        """Which episodes have ended by a fall or by divergence [count]."""
        return np.not_equal(self._row(FELL) + self._row(DIVERGED), 0.0)

    @property
    def truncated(self) -> Flags:
        """Which episodes have reached the plan's duration [count]."""
        return np.greater_equal(self.steps[: self.count], self.course.last)
