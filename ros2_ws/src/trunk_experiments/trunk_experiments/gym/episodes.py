"""Many episodes of a task side by side: each is a lane, and compiled code steps sixteen at once.

The lanes call the same functions as every run, and their cells are like those of `batch.lanes`, block after
block. Each lane has its own time: ``steps`` says how many steps into its episode it is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from itertools import repeat
from math import nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunk_control.law import Constants, Law, LawMemory, Sample, limited
from trunk_control.laws import law_of
from trunk_core.arrays import Floats, Integers
from trunk_core.compiled import compiled_or_plain, twin, with_arrays
from trunk_core.errors import ActionError, PlanError
from trunk_core.text import shortened
from trunk_runs.loop import reading_of
from trunk_sim.disturbances import Disturbance, Signals
from trunk_sim.noise import fill, random_bits
from trunk_sim.plant import PlantState, rk4_step
from trunk_sim.step import (
    Dynamics,
    Measurement,
    beyond_fall,
    finite,
    sense,
    torque_of,
)
from trunk_studies.batch.compiled_run import NotCompiledWarning
from trunk_studies.batch.lanes import (
    LANES,
    Common,
    fill_disturbances,
    fill_references,
    made_of,
    reader_of,
    row_values,
    rows_of,
    writer_of,
)

from .task import Drawn, Task, lost


class Standing(NamedTuple):
    """An episode after a period of the plant."""

    state: PlantState
    torque: float  # N m, over the last period whose state was accepted
    reward: float  # of the step so far
    fell: bool
    diverged: bool
    over: bool


class Episode(NamedTuple):
    """What a lane keeps of its episode."""

    standing: Standing
    seen: PlantState  # by the sensors
    acting: Disturbance
    noise: tuple[float, float]  # samples
    measured: Measurement
    wanted: float  # rad, the reference now
    command: float  # N m, within the controller's limits
    torque: float  # N m, within the actuator's limits
    forces: tuple[float, float]  # N or N m, on both coordinates over the period
    state: PlantState  # within the period
    memory: LawMemory
    action: Any  # a torque in N m, or the law's constants


def beginning(state: PlantState, memory: LawMemory, action: Any) -> Episode:
    """Return an episode before its first step."""
    return Episode(
        standing=Standing(state, 0.0, 0.0, False, False, False),
        seen=state,
        acting=Disturbance(),
        noise=(0.0, 0.0),
        measured=Measurement(0.0, 0.0, 0.0, 0.0),
        wanted=0.0,
        command=0.0,
        torque=0.0,
        forces=(0.0, 0.0),
        state=state,
        memory=memory,
        action=action,
    )


_EPISODE = beginning(PlantState(0.0, 0.0, 0.0, 0.0), (), ())  # of any law
ROWS = rows_of(_EPISODE)
_STANDING = rows_of(_EPISODE.standing)  # the first part: its rows are the episode's
read, _ = reader_of(_EPISODE, 0, whole=True)
keep_standing = writer_of(_EPISODE.standing, ROWS.standing)
keep_measured = writer_of(_EPISODE.measured, ROWS.measured)
keep_forces = writer_of(_EPISODE.forces, ROWS.forces)
keep_state = writer_of(_EPISODE.state, ROWS.state)

OBSERVED = 5  # numbers of an observation


class Course(NamedTuple):
    """What all episodes have in common."""

    common: Common  # but the law's constants, which an action may be
    effort_weight: float  # rad^2 / (N m)^2
    lost: float  # rad^2


class EpisodeSeries(NamedTuple):
    """Inputs over time [episodes, states, numbers]; one episode if all share it, empty if there is none."""

    reference: Floats  # [states]
    acting: Floats  # 4 numbers
    noise: Floats  # 2 numbers


@cache
def advance_of(law: Law, dynamics: Dynamics, constants: Constants | None) -> Callable[..., None]:
    """Return the function that steps every episode under an action: a torque, or the law's ``constants``.

    ``advance(course, blocks, steps, series, history, actions)`` takes ``every`` periods of the plant, fewer
    if the episode ends. ``blocks`` [blocks, rows LANES]; ``actions`` [episodes, numbers]; ``history``
    [delay_steps + 1, 4, lanes] has the states of the last periods. ``constants`` give the structure.
    """
    update = law.update
    example = beginning(_EPISODE.state, law.memory, (0.0,) if constants is None else constants)
    read_whole, _ = reader_of(example, 0, whole=True)
    rows = rows_of(example)
    forces, accelerations = dynamics
    keep_memory = writer_of(example.memory, rows.memory)

    def by_torque(c: Common, cells: Floats, lane: int, dt: float) -> float:
        return limited(read_whole(cells, lane, ()).action[0], c.limits)

    def by_constants(c: Common, cells: Floats, lane: int, dt: float) -> float:
        here = read_whole(cells, lane, ())
        reading = reading_of(0, here.measured, 0.0, c.hip, nan)
        sample = Sample(here.wanted, reading.position, reading.velocity, dt, reading.hip)
        memory, terms = update(here.memory, sample, here.action, c.limits)
        keep_memory(memory, cells, lane)
        effort: float = terms.effort
        return effort

    command = by_torque if constants is None else by_constants

    def advance(
        course: Course,
        blocks: Floats,
        steps: Integers,
        series: EpisodeSeries,
        history: Floats,
        actions: Floats,
    ) -> None:
        c = course.common
        h = c.plant.period / c.plant.substeps
        for block in range(len(blocks)):
            cells, first = blocks[block], block * LANES
            for lane in range(LANES):
                row = min(first + lane, len(actions) - 1)
                for i in range(actions.shape[1]):
                    cells[(rows.action + i) * LANES + lane] = actions[row, i]
                s = read(cells, lane, ()).standing
                begun = Standing(s.state, s.torque, 0.0, s.fell, s.diverged, False)
                keep_standing(begun, cells, lane)
            for lane in range(LANES):
                dt = c.first_dt if steps[first + lane] == 0 else c.dt
                cells[ROWS.command * LANES + lane] = command(c, cells, lane, dt)
            for _ in range(c.update_every):
                fetch(series.acting, c, steps, first, ROWS.acting, cells)
                for lane in range(LANES):
                    here = read(cells, lane, ())
                    state = here.standing.state
                    torque = torque_of(here.standing.torque, here.command, c.plant)
                    pushed = forces(torque, here.acting, state, c.plant.actuator)
                    cells[ROWS.torque * LANES + lane] = torque
                    keep_forces(pushed, cells, lane)
                    keep_state(state, cells, lane)
                for _ in range(c.plant.substeps):
                    for lane in range(LANES):
                        here = read(cells, lane, ())
                        constants = c.plant.constants
                        first_force, second_force = here.forces
                        state = rk4_step(
                            here.state, first_force, second_force, h, constants, accelerations
                        )
                        keep_state(state, cells, lane)
                for lane in range(LANES):
                    here, k = read(cells, lane, ()), steps[first + lane]
                    reference = series.reference[min(k + 1, c.states - 1)]
                    after, k = settled(here.standing, here.state, here.torque, k, reference, course)
                    keep_standing(after, cells, lane)
                    steps[first + lane] = k
                    if c.delay_steps:
                        for i in range(4):
                            history[k % len(history), i, first + lane] = after.state[i]

    motion = f"{accelerations.__module__}_{accelerations.__name__}"
    name = f"{command.__name__}_{motion}_{update.__module__}"
    advance.__name__ = advance.__qualname__ = name
    return advance


def settled(
    before: Standing, state: PlantState, torque: float, k: int, reference: float, course: Course
) -> tuple[Standing, int]:
    """Return an episode and its step after a period that led to a state; one that is not finite ends it.

    ``reference`` is that of the new state; the torque was applied over the period.
    """
    s, c = before, course.common
    last = c.states - 1
    if s.over or k >= last:
        return Standing(s.state, s.torque, s.reward, s.fell, s.diverged, True), k
    if not finite(state):
        rest = c.plant.period * (last - k) * course.lost
        return Standing(s.state, s.torque, s.reward - rest, s.fell, True, True), k
    k += 1
    error = reference - state.theta
    reward = -c.plant.period * (error * error + course.effort_weight * torque * torque)
    falls = c.fall_stop and beyond_fall(state, c.plant)
    if falls:
        reward -= c.plant.period * (last - k) * course.lost
    over = falls or k == last
    return Standing(state, torque, s.reward + reward, s.fell or falls, s.diverged, over), k


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
    c = course.common
    for block in range(len(blocks)):
        cells, first = blocks[block], block * LANES
        for lane in range(LANES):
            cells[ROWS.wanted * LANES + lane] = series.reference[
                min(steps[first + lane], c.states - 1)
            ]
        if c.delay_steps:
            for lane in range(LANES):
                then = max(steps[first + lane] - c.delay_steps, 0) % len(history)
                for i in range(4):
                    cells[(ROWS.seen + i) * LANES + lane] = history[then, i, first + lane]
        else:
            for i in range(4 * LANES):
                cells[ROWS.seen * LANES + i] = cells[ROWS.standing * LANES + i]  # its state
        fetch(series.acting, c, steps, first, ROWS.acting, cells)
        fetch(series.noise, c, steps, first, ROWS.noise, cells)
        for lane in range(LANES):
            here = read(cells, lane, ())
            position_sample, velocity_sample = here.noise
            measured = sense(here.seen, here.acting, position_sample, velocity_sample, c.sensor)
            keep_measured(measured, cells, lane)
        for lane in range(min(LANES, len(out) - first)):
            here = read(cells, lane, ())
            out[first + lane, 0] = here.measured.theta
            out[first + lane, 1] = here.measured.theta_dot
            out[first + lane, 2] = here.wanted
            out[first + lane, 3] = here.measured.x
            out[first + lane, 4] = here.measured.x_dot


def fetch(series: Floats, c: Common, steps: Integers, first: int, row: int, cells: Floats) -> None:
    """Write the values of a series [episodes, states, numbers] at each episode's time, if it has any."""
    if not len(series):
        return
    for lane in range(LANES):
        episode = min(first + lane, len(series) - 1)
        k = min(steps[first + lane], c.states - 1)
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
        shared = common._replace(plant=with_arrays(common.plant), constants=())
        self.course = Course(shared, task.effort_weight, lost(task))
        law, example = law_of(task.plan.controller), task.constants
        if example is not None:
            example = made_of(example, repeat(0.0))  # one function, whatever the numbers
        self._advance = compiled_or_plain(
            advance_of(law, task.regular.dynamics, example),
            lambda reason: warnings.warn(NotCompiledWarning((law.name,), reason), stacklevel=2),
        )
        lanes, rows = -(-count // LANES) * LANES, len(self._beginning(_EPISODE.state))
        self._blocks = np.zeros((lanes // LANES, rows * LANES))
        self._cells = self._blocks.reshape(-1, rows, LANES)
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

    def _beginning(self, state: PlantState) -> list[float]:
        """Return the cells of an episode before its first step."""
        task = self.task
        action = (0.0,) if task.constants is None else task.constants
        return row_values(beginning(state, task.regular.memory, action), whole=True)

    def begin(self, episode: int, drawn: Drawn) -> None:
        """Begin an episode anew."""
        block, lane = divmod(episode, LANES)
        self._cells[block, :, lane] = self._beginning(PlantState(*drawn.initial))
        self._history[0, :, episode] = drawn.initial
        self.steps[episode] = 0
        if self._noisy:
            bits = random_bits(drawn.sensor_seed, 0, self.course.common.states)
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
        self._advance(self.course, self._blocks, self.steps, self._series, self._history, taken)
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
        return self._row(_STANDING.state + 1)

    @property
    def rewards(self) -> Floats:
        """The rewards of the last step [count]."""
        return self._row(_STANDING.reward)

    @property
    def commands(self) -> Floats:
        """The commanded torques of the last step [count], N m, within the controller's limits."""
        return self._row(ROWS.command)

    @property
    def torques(self) -> Floats:
        """The torques that were applied over the last period [count], N m."""
        return self._row(_STANDING.torque)

    @property
    def diverged(self) -> Flags:
        """Which episodes' next state would not be finite [count]."""
        return np.not_equal(self._row(_STANDING.diverged), 0.0)

    @property
    def terminated(self) -> Flags:
        """Which episodes have ended by a fall or by divergence [count]."""
        return np.not_equal(self._row(_STANDING.fell), 0.0) | self.diverged

    @property
    def truncated(self) -> Flags:
        """Which episodes have reached the plan's duration [count]."""
        return np.greater_equal(self.steps[: self.count], self.course.common.states - 1)
