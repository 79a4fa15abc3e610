#!/usr/bin/env python3
"""Train a policy by PPO of stable-baselines3, and compare it with Fuzzy-PID and LQR on seeds held out.

    source scripts/env.sh
    pip install -r examples/train_ppo.txt
    python examples/train_ppo.py -o runs/ppo

The policy gives the torque, up to 20 N m, from the observation: two layers of 64. Episodes are those of
``trunk/Balance-v0``: a fall ends them. All three meet the same initial states, disturbances and noise.
"""

from __future__ import annotations

import argparse
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from trunk_experiments.analysis.metrics import metrics
from trunk_experiments.analysis.run_table import RunTable
from trunk_experiments.batch.block import summaries
from trunk_experiments.batch.compiled_run import Batch
from trunk_experiments.gym import ENVIRONMENT
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.study.intervals import mean_interval, wilson
from trunk_msgs_util.errors import TrunkError

Floats: TypeAlias = NDArray[np.float64]

TORQUE = 20.0  # N m, of an action of 1
HELD_OUT = 1_000_000  # the first seed of the comparison; training draws its own from --seed on
RIVALS = ("fuzzy_pid", "lqr")


class Trunks(VecEnv):
    """Our vector environment as stable-baselines3 takes one."""

    def __init__(self, count: int, scenario: str) -> None:
        self._envs: Any = gymnasium.make_vec(
            ENVIRONMENT,
            count,
            "vector_entry_point",
            scenario=scenario,
            autoreset_mode=AutoresetMode.SAME_STEP,
        )
        box = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        super().__init__(count, self._envs.single_observation_space, box)
        self._actions: Floats = np.zeros((count, 1))

    def reset(self) -> Floats:
        seen: Floats = self._envs.reset(seed=None if self._seeds[0] is None else self._seeds)[0]
        return seen

    def step_async(self, actions: Floats) -> None:
        self._actions = TORQUE * np.asarray(actions, np.float64)

    def step_wait(self) -> Any:
        seen, rewards, terminated, truncated, more = self._envs.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(terminated | truncated):
            infos[i]["terminal_observation"] = more["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        return seen, rewards, terminated | truncated, infos

    def close(self) -> None:
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **more: Any) -> Any:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


def train(scenario: str, steps: int, seed: int) -> Callable[[Floats], Floats]:
    """Return the trained policy: from an observation to a torque [1], N m."""
    trunks = Trunks(64, scenario)
    trunks.seed(seed)
    envs = VecNormalize(trunks, gamma=0.99)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=256,
        batch_size=2048,
        n_epochs=5,
        gamma=0.99,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.5},
        seed=seed,
        device="cpu",
    )
    began = time.process_time()
    model.learn(steps)
    print(f"{model.num_timesteps} steps in {time.process_time() - began:.0f} s of the processor")

    def policy(seen: Floats) -> Floats:
        action, _ = model.predict(envs.normalize_obs(seen), deterministic=True)
        return TORQUE * np.clip(np.asarray(action, np.float64), -1.0, 1.0)

    return policy


def measured(
    scenario: str, policy: Callable[[Floats], Floats], episodes: int, folder: Path
) -> dict[str, Floats]:
    """Return the IAE of each episode, rad s, by controller; NaN for one that fell."""
    env: Any = gymnasium.make(ENVIRONMENT, scenario=scenario)
    task = env.unwrapped.task
    rivals = {name: make_plan(scenario, name).controllers for name in RIVALS}
    plans: dict[str, list[Any]] = {name: [] for name in RIVALS}
    found: dict[str, list[float]] = {"ppo": []}
    for seed in range(HELD_OUT, HELD_OUT + episodes):
        seen, _ = env.reset(seed=seed)
        fell = over = False
        while not over:
            seen, _, fell, truncated, _ = env.step(policy(seen))
            over = fell or truncated
        file = env.unwrapped.save(folder / "ppo.mcap", overwrite=True)  # the last one is kept
        table = RunTable.from_run(RecordedRun.open(file))
        found["ppo"].append(np.nan if fell else metrics(table).iae)
        plan = task.plan_of(task.draw(seeding.np_random(seed)[0]))
        for name, controllers in rivals.items():
            plans[name].append(replace(plan, controllers=controllers))
    batch = Batch()
    for name in RIVALS:
        outcomes = [run.metrics for run in summaries(plans[name], batch)]
        stood = [m is not None and max(m.theta_max_deg, -m.theta_min_deg) < 90.0 for m in outcomes]
        found[name] = [
            m.iae if good and m is not None else np.nan
            for m, good in zip(outcomes, stood, strict=True)
        ]
    return {name: np.array(values) for name, values in found.items()}


def show(iae: dict[str, Floats]) -> None:
    """Print how often each fell, its mean IAE, and the differences where both stood."""
    for name, values in iae.items():
        falls, count = int(np.isnan(values).sum()), len(values)
        share, mean = wilson(falls, count), mean_interval(values[~np.isnan(values)])
        print(
            f"{name:10} fell {falls} of {count} ({100 * share.low:.1f} to {100 * share.high:.1f} %), "
            f"IAE {mean.value:.4f} ({mean.low:.4f} to {mean.high:.4f}) rad s where it stood"
        )
    for name in RIVALS:
        apart = iae["ppo"] - iae[name]
        apart = apart[~np.isnan(apart)]
        mean = mean_interval(apart)
        print(
            f"ppo minus {name}: {mean.value:+.4f} ({mean.low:+.4f} to {mean.high:+.4f}) rad s, "
            f"{len(apart)} pairs in which both stood"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to make")
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.output.exists():
        parser.error(f"--output {given.output}: it exists: name a folder that does not")
    if given.steps < 1 or given.episodes < 1 or given.seed < 0:
        parser.error("--steps and --episodes must be 1 or more, --seed 0 or more")
    try:
        policy = train(given.scenario, given.steps, given.seed)
        given.output.mkdir(parents=True)
        show(measured(given.scenario, policy, given.episodes, given.output))
    except (TrunkError, OSError) as error:
        parser.error(str(error))
    subprocess.run(["trunk", "verify", given.output / "ppo.mcap"], check=True)


if __name__ == "__main__":
    main()
