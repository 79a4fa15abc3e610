"""``trunk/Balance-v0``: one trunk as a Gymnasium environment, and many side by side in compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from trunk_core.arrays import Floats
from trunk_core.errors import PlanError, did_you_mean
from trunk_runs.plan import advice

from .episodes import OBSERVED, Episodes, Flags, real_numbers
from .task import Drawn, Task, make_task, save_episode

OPTIONS = ("as_planned",)  # of reset


def space_of_actions(task: Task) -> spaces.Space[Floats]:
    """Return the space of the torque [N m], or of the constants of the controller's law."""
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
    """Hold a trunk at its reference by choosing a torque, or a law's constants, in every control period.

    Observation, float64: measured angle [rad] and rate [rad/s], reference [rad], measured position [m] and
    rate [m/s] of the hip. Action, float64: torque [N m], or the constants, which are kp, ki, kd of ``pid``.
    Reward, with the true angle theta and the torque tau after each of the plant's periods h in the step::

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
        taken = episodes.advance(real_numbers(action, self.task.low.shape)[None])
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


MODES = {mode.value: mode for mode in AutoresetMode}

Infos = dict[str, Any]


class BalanceVectorEnv(VectorEnv[Floats, Floats, Any]):
    """Many `BalanceEnv` with the same options; with seed s, environment i has the bits of seed s + i.

    ``autoreset_mode``: "NextStep" (an episode that has ended restarts in the next step, which ignores the
    action and gives no reward), "SameStep" (at once; the last observation and info are in ``final_obs``
    and ``final_info``), or "Disabled" (``reset(options={"reset_mask": ...})`` restarts some).
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Path = "demo",
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Raise PlanError for options that do not make a plan."""
        if render_mode is not None:
            raise PlanError(
                f"render_mode {render_mode!r}: rendering is not supported; plot a saved episode instead"
            )
        if not isinstance(num_envs, int) or num_envs < 1:
            raise PlanError(f"num_envs {num_envs!r}: give 1 or more")
        self.mode = _mode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.mode}
        self.num_envs = num_envs
        self.task = with_warnings_logged(make_task(scenario, **options))
        self.single_action_space = space_of_actions(self.task)
        self.single_observation_space = space_of_observations()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._episodes = Episodes(self.task, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._over: Flags = np.zeros(num_envs, dtype=np.bool_)
        self._begun: Flags = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Floats, Infos]:
        """Begin all episodes, or those in the option ``reset_mask``; ``as_planned`` is as in `BalanceEnv`.

        ``seed``: s, which gives s, s + 1, ...; or one for each environment.
        """
        as_planned = wants_plan(options, (*OPTIONS, "reset_mask"))
        mask = self._mask((options or {}).get("reset_mask"))
        for i, own_seed in enumerate(self._seeds(seed)):
            if own_seed is not None and mask[i]:
                self._generators[i] = seeding.np_random(own_seed)[0]
        self._begin(mask, as_planned)
        return self._episodes.observations(), self._infos(mask)

    def step(self, actions: Floats) -> tuple[Floats, Floats, Flags, Flags, Infos]:
        """Run one control period of every episode. Raises ActionError as `BalanceEnv` does."""
        if not self._begun.all():
            raise ResetNeeded("step: reset the environments first")
        over, episodes = self._over, self._episodes
        if self.mode is AutoresetMode.DISABLED and over.any():
            raise ResetNeeded(
                f"step: the episode of environment {int(np.argmax(over))} has ended: reset it by reset_mask"
            )
        episodes.advance(actions)
        if over.any():
            self._begin(over, False)
        rewards, terminated, truncated = episodes.rewards, episodes.terminated, episodes.truncated
        observations, infos = episodes.observations(), self._infos()
        self._over = terminated | truncated
        if self.mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos = self._begun_at_once(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def _begun_at_once(self, last: Floats, infos: Infos) -> tuple[Floats, Infos]:
        """Begin the episodes that are over; return the first observations, with the last in the infos."""
        over = self._over
        finals = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(over):
            finals[i] = last[i]
        final_info = {name: np.zeros_like(value) for name, value in infos.items()}
        for name, value in infos.items():
            final_info[name][over] = value[over]
        self._begin(over, False)
        return self._episodes.observations(), {
            "final_obs": finals,
            "_final_obs": over.copy(),
            "final_info": final_info,
            "_final_info": over.copy(),
            **self._infos(),
        }

    def _begin(self, mask: Flags, as_planned: bool) -> None:
        """Begin the episodes of a mask anew."""
        for i in np.flatnonzero(mask).tolist():
            drawn = self.task.as_planned if as_planned else self.task.draw(self._generator(i))
            self._episodes.begin(i, drawn)
        self._over = self._over & ~mask
        self._begun |= mask

    def _generator(self, i: int) -> np.random.Generator:
        generator = self._generators[i]
        if generator is None:
            generator = self._generators[i] = seeding.np_random()[0]
        return generator

    def _infos(self, mask: Flags | None = None) -> Infos:
        """Return the infos of `BalanceEnv`, one array each, and which environments they are for."""
        episodes = self._episodes
        infos: Infos = {
            "step": episodes.steps[: self.num_envs].copy(),
            "angle": episodes.angles,
            "torque": episodes.torques,
            "diverged": episodes.diverged,
        }
        there = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask
        return infos | {f"_{name}": there.copy() for name in infos}

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise PlanError(
                f"reset: {len(seed)} seeds for {self.num_envs} environments: give one for each"
            )
        return seed

    def _mask(self, given: object) -> Flags:
        if given is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise PlanError(
                f"reset: reset_mask has shape {mask.shape} and type {mask.dtype}; "
                f"give {self.num_envs} flags, of which at least one is true"
            )
        return mask.copy()


def _mode(given: str | AutoresetMode) -> AutoresetMode:
    if isinstance(given, AutoresetMode):
        return given
    if given not in MODES:
        raise PlanError(
            f"autoreset_mode {given!r}: give one of {', '.join(MODES)}{did_you_mean(str(given), MODES)}"
        )
    return MODES[given]
