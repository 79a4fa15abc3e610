"""Many episodes of a task side by side, in compiled code: each is a lane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trunk_msgs_util.compiled import twin, with_arrays
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.disturbances import Signals
from trunk_sim.noise import fill, random_bits
from trunk_sim.step import pruned

from ..batch.cells import STATE
from ..batch.columns import LANES
from ..batch.lanes import fill_disturbances, fill_references
from ..errors import ActionError, PlanError
from .kernel import (
    APPLIED,
    COMMAND,
    DIVERGED,
    FELL,
    OBSERVED,
    PID,
    REWARD,
    ROWS,
    Course,
    EpisodeSeries,
    advance,
    observe,
)
from .task import Drawn, Task, lost

MOST_BYTES = 2 * 1024**3  # of the series of all episodes

Flags = NDArray[np.bool_]


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

        Raises ActionError for a wrong shape, and for numbers that are not finite.
        """
        taken = np.ascontiguousarray(actions, dtype=np.float64)
        shape = self.count, len(self.task.low)
        if taken.shape != shape:
            raise ActionError(f"action: its shape is {taken.shape}, it must be {shape}")
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
