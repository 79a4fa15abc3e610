#!/usr/bin/env python3
"""Train a network by Soft Actor-Critic (stable-baselines3), and compare it with Fuzzy-PID and LQR.

    source scripts/env.sh
    pip install --target ~/sb3 stable-baselines3    # with PyTorch, 5 GB: beside .venv, not in it
    PYTHONPATH=$PYTHONPATH:~/sb3 python examples/train_sac.py -o runs/sac

The network chooses a torque of up to ``TORQUE``, held for ``HOLD`` control periods. It is judged on episodes
that it was not trained on; every controller begins each of them in the same state.
"""

from __future__ import annotations

import argparse
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from numpy.typing import NDArray

import trunk_experiments.api as trunk
from trunk_core.errors import TrunkError
from trunk_experiments.gym import ENVIRONMENT

Floats: TypeAlias = NDArray[np.float64]
Changes: TypeAlias = Mapping[str, float]  # by NODE.PARAM, SI units

HOLD = 4  # control periods: 20 ms in the scenario demo
TORQUE = 15.0  # N m, of an action of 1; gravity needs at most 4.9
FALL = -10.0  # reward of a fall
HELD_OUT = 1_000_000  # seed of the first episode for judging
OTHERS = "fuzzy_pid", "lqr"
METRICS = "iae", "effort", "peak_torque"


class Balance(gymnasium.Wrapper):  # type: ignore[type-arg]
    """Scaled observations, an action in [-1, 1] that is held, and a reward of about 1 for standing.

    Observation: error [rad], rate in units of 5 rad/s, the hip's speed [m/s], and sine and cosine of its
    position, on whose path one period is 2 pi m.
    """

    def __init__(self, env: gymnasium.Env[Floats, Floats]) -> None:
        super().__init__(env)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (5,), np.float32)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        measured, info = self.env.reset(**options)
        return scaled(measured), info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        torque = TORQUE * np.asarray(action, dtype=np.float64)
        for _ in range(HOLD):
            measured, _, fell, over, info = self.env.step(torque)
            if fell or over:
                break
        error, rate = abs(measured[2] - info["angle"]), min(abs(measured[1]), 10.0)
        cost = error + 0.03 * rate + 0.05 * float(action[0]) ** 2
        return scaled(measured), FALL if fell else 1.0 - cost, fell, over, info


def scaled(measured: Floats) -> Any:
    angle, rate, reference, x, speed = measured
    seen = (reference - angle, rate / 5.0, speed, np.sin(x), np.cos(x))
    return np.array(seen, dtype=np.float32)


def make(scenario: str, changes: Changes = MappingProxyType({})) -> Balance:
    settings = [f"{name}={value}" for name, value in changes.items()]
    return Balance(gymnasium.make(ENVIRONMENT, scenario=scenario, settings=settings))


def train(scenario: str, steps: int, seed: int) -> Any:
    """Return the trained model; a step is ``HOLD`` control periods."""
    from stable_baselines3 import SAC

    model = SAC(
        "MlpPolicy",
        make(scenario),
        learning_rate=1e-3,
        gamma=0.98,  # 1 s
        tau=0.01,
        learning_starts=min(1000, steps),
        policy_kwargs={"net_arch": [64, 64]},
        seed=seed,
        device="cpu",
    )
    return model.learn(steps)


def record(model: Any, env: Balance, path: Path, **how: Any) -> trunk.Run:
    """Record an episode of the policy's mean action."""
    seen, _ = env.reset(**how)
    over = False
    while not over:
        seen, _, fell, ended, _ = env.step(model.predict(seen, deterministic=True)[0])
        over = fell or ended
    env.unwrapped.save(path, overwrite=True)
    return trunk.load(path)


def simulated(scenario: str, controller: str, changes: Changes, like: trunk.Run) -> trunk.Run:
    """Return a controller's run from the initial state of another run."""
    start = {
        "simulator.initial.position": [like.x[0], like.theta[0]],
        "simulator.initial.velocity": [like.x_dot[0], like.theta_dot[0]],
        "simulator.fall.stop": True,  # as the environment's episodes
    }
    return trunk.simulate(trunk.plan(scenario, controller, overrides={**changes, **start}))


def judge(model: Any, scenario: str, changes: Changes, episodes: int) -> dict[str, Floats]:
    """Return each controller's metrics over held-out episodes [episodes, METRICS], NaN where it fell."""
    env = make(scenario, changes)
    rows: dict[str, list[list[float]]] = {name: [] for name in ("policy", *OTHERS)}
    with TemporaryDirectory() as folder:
        for k in range(episodes):
            run = record(model, env, Path(folder) / "run.mcap", seed=HELD_OUT + k)
            runs = {name: simulated(scenario, name, changes, run) for name in OTHERS}
            for name, judged in {"policy": run, **runs}.items():
                fell = judged.fell_at is not None
                metrics = trunk.metrics(judged)
                rows[name].append([np.nan if fell else getattr(metrics, m) for m in METRICS])
    return {name: np.array(row) for name, row in rows.items()}


def show(judged: dict[str, Floats]) -> None:
    """Print falls, and medians over the episodes in which nobody fell."""
    stood = ~np.any([np.isnan(rows[:, 0]) for rows in judged.values()], axis=0)
    heads = (f"{name}, {trunk.UNITS[name]}" for name in METRICS)
    print(f"{'controller':12}{'fell':>12}", *(f"{head:>22}" for head in heads), sep="")
    for name, rows in judged.items():
        fell = f"{int(np.isnan(rows[:, 0]).sum())} of {len(rows)}"
        medians = np.median(rows[stood], axis=0) if stood.any() else [np.nan] * len(METRICS)
        print(f"{name:12}{fell:>12}", *(f"{median:22.4g}" for median in medians), sep="")
    better = {name: int(np.sum((judged["policy"] < judged[name])[stood, 0])) for name in OTHERS}
    print(*(f"IAE below {name}'s: {n} of {stood.sum()}" for name, n in better.items()), sep="; ")


def change(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name, float(value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to make")
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--steps", type=int, default=20_000, help=f"of {HOLD} control periods")
    parser.add_argument("--episodes", type=int, default=100, help="held-out ones")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--policy", type=Path, help="judge this one instead of training")
    parser.add_argument(
        "--set",
        type=change,
        action="append",
        default=[],
        metavar="NODE.PARAM=NUMBER",
        help="a change in the held-out episodes alone, in SI units; repeatable",
    )
    given = parser.parse_args()
    try:
        from stable_baselines3 import SAC
    except ImportError:
        parser.error("stable_baselines3 is not installed: see the top of this file")
    if given.output.exists():
        parser.error(f"--output {given.output}: it exists: name a folder that does not")
    if given.steps < 1 or given.episodes < 1 or given.seed < 0:
        parser.error("--steps and --episodes must be 1 or more, --seed 0 or more")
    begun = time.monotonic()
    try:
        model = (
            SAC.load(given.policy, device="cpu")
            if given.policy
            else train(given.scenario, given.steps, given.seed)
        )
        print(f"{model.num_timesteps} steps; {time.monotonic() - begun:.0f} s")
        given.output.mkdir(parents=True)
        model.save(given.output / "policy.zip")
        show(judge(model, given.scenario, dict(given.set), given.episodes))
        policy = given.output / "policy.mcap"
        planned = record(model, make(given.scenario), policy, options={"as_planned": True})
        recordings = [policy]
        for name in OTHERS:
            recordings.append(given.output / f"{name}.mcap")
            simulated(given.scenario, name, {}, planned).save(recordings[-1])
    except (TrunkError, OSError) as error:
        parser.error(str(error))
    for words in (
        ["verify", policy],
        ["compare", *recordings],
        ["report", *recordings, "-o", given.output / "report.html"],
    ):
        subprocess.run(["trunk", *words], check=True)


if __name__ == "__main__":
    main()
