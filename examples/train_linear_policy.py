#!/usr/bin/env python3
"""Train a linear policy by the cross-entropy method, and compare an episode of it with Fuzzy-PID.

    source scripts/env.sh
    python examples/train_linear_policy.py -o runs/cem

The torque is ``w · observation``: five weights. Each generation draws as many sets of weights as there are
environments, runs an episode with each, all from the same initial state, and draws the next generation
around the mean of the best ones, as widely as these differ.
"""

from __future__ import annotations

import argparse
import subprocess
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from numpy.typing import NDArray

from trunk_core.errors import TrunkError
from trunk_experiments.gym import ENVIRONMENT

Floats: TypeAlias = NDArray[np.float64]

ELITE = 0.2  # share of a generation that the next one is drawn around
UNTIL_A_FALL = ["--set", "simulator.fall.stop=true"]  # as the environment's episodes
WIDTHS = np.array([50.0, 10.0, 50.0, 5.0, 5.0])  # of the first: per rad, rad/s, rad, m, m/s


def returns(envs: Any, weights: Floats, seed: int) -> Floats:
    """Return the sum of rewards of an episode with each set of weights [environments, 5]."""
    seen, _ = envs.reset(seed=[seed] * envs.num_envs)
    total, running = np.zeros(envs.num_envs), np.ones(envs.num_envs, dtype=bool)
    while running.any():
        actions = np.sum(weights * seen, axis=1, keepdims=True)
        seen, rewards, terminated, truncated, _ = envs.step(actions)
        total[running] += rewards[running]
        running &= ~(terminated | truncated)
    return total


def train(scenario: str, generations: int, population: int, seed: int) -> Floats:
    """Return the mean weights of the last generation's best."""
    envs = gymnasium.make_vec(ENVIRONMENT, population, "vector_entry_point", scenario=scenario)
    generator = np.random.default_rng(seed)
    mean, width = np.zeros_like(WIDTHS), WIDTHS
    for generation in range(generations):
        drawn = mean + width * generator.standard_normal((population, len(WIDTHS)))
        found = returns(envs, drawn, seed + generation)
        best = drawn[np.argsort(found)[-max(2, round(ELITE * population)) :]]
        mean, width = best.mean(axis=0), best.std(axis=0)
        print(
            f"generation {generation + 1}: best return {found.max():.4f}, median {np.median(found):.4f}"
        )
    return mean


def saved(scenario: str, weights: Floats, path: Path) -> float:
    """Save the scenario's own episode with these weights as a recording; return the sum of its rewards."""
    env: Any = gymnasium.make(ENVIRONMENT, scenario=scenario)
    seen, _ = env.reset(options={"as_planned": True})
    total, over = 0.0, False
    while not over:
        seen, reward, terminated, truncated, _ = env.step(np.array([weights @ seen]))
        total, over = total + float(reward), terminated or truncated
    env.unwrapped.save(path)
    return total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to make")
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--generations", type=int, default=30)
    parser.add_argument("--population", type=int, default=64)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.output.exists():
        parser.error(f"--output {given.output}: it exists: name a folder that does not")
    if given.generations < 1 or given.population < 2 or given.seed < 0:
        parser.error("--generations must be 1 or more, --population 2 or more, --seed 0 or more")
    policy, fuzzy = given.output / "policy.mcap", given.output / "fuzzy_pid.mcap"
    try:
        weights = train(given.scenario, given.generations, given.population, given.seed)
        given.output.mkdir(parents=True)
        print(
            f"weights {weights.round(3).tolist()}, return {saved(given.scenario, weights, policy):.4f}"
        )
    except (TrunkError, OSError) as error:
        parser.error(str(error))
    report = given.output / "report.html"
    for words in (
        ["simulate", given.scenario, *UNTIL_A_FALL, "--controller", "fuzzy_pid", "-o", fuzzy],
        ["verify", policy],
        ["compare", policy, fuzzy],
        ["report", policy, fuzzy, "-o", report],
    ):
        subprocess.run(["trunk", *words], check=True)


if __name__ == "__main__":
    main()
