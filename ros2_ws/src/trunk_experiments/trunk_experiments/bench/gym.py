"""Our vector environment against Gymnasium's CartPole: as many trunks as carts, on one core.

Steps per second of processor time, taken alternately. CartPole's step is one Euler step, ours is one
Runge-Kutta step or ten, with the sensors, the reward and, where the actions are gains, a PID update.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

from .lanes import alternately
from .rates import RateRow

GOAL_HZ = 1e6  # at least: our steps per second and core
STEPS = 200  # of all environments, in a round
_GAINS = (60.0, 100.0, 9.0)


def bench_gym(rounds: int = 5, count: int = 1024) -> list[RateRow]:
    """Return the comparisons at ``count`` environments. Raises NotInstalledError without Gymnasium."""
    from ..gym import ENVIRONMENT  # says what is missing

    import gymnasium  # isort: skip

    generator = np.random.default_rng(1)
    carts = gymnasium.make_vec(
        "CartPole-v1", num_envs=count, vectorization_mode="vector_entry_point"
    )
    pushes = generator.integers(0, 2, (STEPS, count))

    def row(name: str, actions: Any, **options: Any) -> RateRow:
        trunks = gymnasium.make_vec(
            ENVIRONMENT, num_envs=count, vectorization_mode="vector_entry_point", **options
        )
        ours, theirs = alternately(
            rounds, STEPS * count, _warm(trunks, actions), _warm(carts, pushes)
        )
        ours_hz, theirs_hz = 1.0 / median(ours), 1.0 / median(theirs)
        ratio = median(b / a for a, b in zip(ours, theirs, strict=True))
        return RateRow(name, ours_hz, theirs_hz, ratio, f">= {GOAL_HZ:g}/s", ours_hz >= GOAL_HZ)

    gains = np.broadcast_to(np.array(_GAINS), (STEPS, count, 3))
    torques = generator.uniform(-20.0, 20.0, (STEPS, count, 1))
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
