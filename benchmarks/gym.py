"""Our vector environment against Gymnasium's CartPole: as many trunks as carts, on one core.

Steps per second of processor time, taken alternately. CartPole's step is one Euler step, ours is one
Runge-Kutta step or ten, with the sensors, the reward and, where the actions are gains, a PID update.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from .harness import Row, alternately

GOAL_HZ = 1e6  # at least: our steps per second and core
STEPS = 200  # of all environments, in a round
_GAINS = (60.0, 100.0, 9.0)


def compare(rounds: int = 5, envs: int = 1024) -> list[Row]:
    """Compare our Gymnasium environment's steps per second per core with CartPole's."""
    from trunk_experiments.gym import ENVIRONMENT  # says what is missing

    import gymnasium  # isort: skip

    generator = np.random.default_rng(1)
    carts = gymnasium.make_vec(
        "CartPole-v1", num_envs=envs, vectorization_mode="vector_entry_point"
    )
    pushes = generator.integers(0, 2, (STEPS, envs))

    def row(name: str, actions: Any, **options: Any) -> Row:
        trunks = gymnasium.make_vec(
            ENVIRONMENT, num_envs=envs, vectorization_mode="vector_entry_point", **options
        )
        ours, theirs = alternately(
            rounds, STEPS * envs, _warm(trunks, actions), _warm(carts, pushes)
        )
        per_s = [[1.0 / s for s in some] for some in (ours, theirs)]
        found = Row.of(name, per_s[0], per_s[1], "1/s")
        return replace(found, goal=f">= {GOAL_HZ:g}/s", met=found.ours >= GOAL_HZ)

    gains = np.broadcast_to(np.array(_GAINS), (STEPS, envs, 3))
    torques = generator.uniform(-20.0, 20.0, (STEPS, envs, 1))
    once = ["simulator.substeps=1"]
    return [
        row("PID, 1 RK4 step", gains, action="gains", settings=once),
        row("PID, 10 RK4 steps", gains, action="gains"),
        row("torques, falls, 1 RK4", torques, settings=once),
    ]


def _warm(environments: Any, actions: Any) -> Callable[[], None]:
    """Return a round's work, after a first step."""
    environments.reset(seed=1)
    environments.step(actions[0])

    def work() -> None:
        for action in actions:
            environments.step(action)

    return work
