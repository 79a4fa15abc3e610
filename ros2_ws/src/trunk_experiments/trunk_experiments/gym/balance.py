"""``trunk/Balance-v0``: one trunk as a Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces

from trunk_msgs_util.recording.joint_arrays import Floats

from ..errors import PlanError
from ..plans.plan import advice
from .episodes import Episodes
from .kernel import OBSERVED
from .saving import save_episode
from .task import Drawn, Task, make_task

OPTIONS = ("as_planned",)  # of reset


def space_of_actions(task: Task) -> spaces.Space[Floats]:
    """Return the space of the torque [N m], or of kp [N m/rad], ki [N m/(rad s)] and kd [N m s/rad]."""
    return cast("spaces.Space[Floats]", spaces.Box(task.low, task.high, dtype=np.float64))


def space_of_observations() -> spaces.Space[Floats]:
    """Return the space of measured angle and rate, reference, and the hip's measured position and rate."""
    box = spaces.Box(-np.inf, np.inf, (OBSERVED,), dtype=np.float64)
    return cast("spaces.Space[Floats]", box)


def with_warnings_logged(task: Task) -> Task:
    """Return the task, after passing the plan's warnings to Gymnasium's logger."""
    about_gains = set(advice(task.plan))  # the policy chooses them
    for warning in task.plan.warnings:
        if warning not in about_gains:
            gymnasium.logger.warn(warning)
    return task


def wants_plan(options: dict[str, Any] | None, known: tuple[str, ...] = OPTIONS) -> bool:
    """Return True if reset's options ask for the plan's own episode. Raises PlanError for unknown options."""
    given = options or {}
    for name in given:
        if name not in known:
            raise PlanError(f"reset: no option {name!r}: give {' or '.join(known)}")
    return bool(given.get("as_planned", False))


class BalanceEnv(gymnasium.Env[Floats, Floats]):
    """Hold a trunk at its reference by choosing a torque, or a PID's gains, in every control period.

    Observation, float64: measured angle [rad] and rate [rad/s], reference [rad], measured position [m] and
    rate [m/s] of the hip. Action, float64: torque [N m], or kp, ki, kd. Reward, with the true angle theta
    and the torque tau after each of the plant's periods h in the step::

        r = - sum h ((reference - theta)^2 + w tau^2)  -  [terminated] (T - t) min(fall.angle, pi)^2

    w is ``effort_weight``, T the duration. Terminated: the trunk has fallen, or the plant diverged.
    Truncated: t = T. Options: see `make_task`.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own declaration)

    def __init__(
        self, scenario: str | Path = "demo", render_mode: str | None = None, **options: Any
    ) -> None:
        """Raise PlanError for options that do not make a plan."""
        if render_mode is not None:
            raise PlanError(
                f"render_mode {render_mode!r}: rendering is not supported; plot a saved episode instead"
            )
        self.task = with_warnings_logged(make_task(scenario, **options))
        self.action_space = space_of_actions(self.task)
        self.observation_space = space_of_observations()
        self._episodes = Episodes(self.task, 1)
        self._drawn: Drawn | None = None
        self._actions: list[Floats] = []
        self._over = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; ``options={"as_planned": True}``: with the plan's own initial state and seeds."""
        super().reset(seed=seed)
        as_planned = wants_plan(options)
        self._drawn = self.task.as_planned if as_planned else self.task.draw(self.np_random)
        self._actions, self._over = [], False
        self._episodes.begin(0, self._drawn)
        return self._episodes.observations()[0], self._info()

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Run one control period. Raises ActionError for an action that is not finite or of a wrong shape."""
        if self._drawn is None:
            raise gymnasium.error.ResetNeeded("step: reset the environment first")
        if self._over:
            raise gymnasium.error.ResetNeeded("step: the episode has ended: reset the environment")
        episodes = self._episodes
        taken = episodes.advance(np.asarray(action, dtype=np.float64)[None])
        self._actions.append(taken[0].copy())
        terminated, truncated = bool(episodes.terminated[0]), bool(episodes.truncated[0])
        self._over = terminated or truncated
        seen, reward = episodes.observations()[0], float(episodes.rewards[0])
        return seen, reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        episodes = self._episodes
        return {
            "step": int(episodes.steps[0]),
            "angle": float(episodes.angles[0]),
            "torque": float(episodes.torques[0]),
            "diverged": bool(episodes.diverged[0]),
        }

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the episode so far as a recording, which ``trunk verify`` can judge; return its path.

        Raises PlanError before the first step, OSError for a file that exists or cannot be written.
        """
        if self._drawn is None or not self._actions:
            raise PlanError(f"save {path}: the episode has no step yet: step first")
        states = None if self._over else int(self._episodes.steps[0]) + 1
        return save_episode(self.task, self._drawn, self._actions, states, Path(path), overwrite)
