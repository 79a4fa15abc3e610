"""Prints a SHA-256 of many runs in lanes: every state, reference and torque, the metrics; environments.

NUMBA_CPU_NAME and NUMBA_CPU_FEATURES choose the instructions, and with them how many lanes go at a time.
"""

import hashlib
from dataclasses import replace

import numpy as np

from trunk_experiments.gym.episodes import Episodes
from trunk_experiments.gym.task import make_task
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import make_plan
from trunk_studies.batch.block import regular_run, run_block
from trunk_studies.batch.lanes import LANES, TRACED

SETTINGS = (
    "simulator.sensor.position_noise=0.003",
    "simulator.sensor.delay=0.002",
    "disturbance.sine.amplitude=0.3",
)


def environments() -> bytes:
    """Return what environments give under random actions: torques, and a PID's gains."""
    found = []
    for action in ("torque", "gains"):
        task = make_task("demo", settings=SETTINGS[:2], action=action)
        episodes, generator = Episodes(task, 2 * LANES), np.random.default_rng(1)
        for i in range(2 * LANES):
            episodes.begin(i, task.draw(generator))
        for _ in range(300):
            episodes.advance(generator.uniform(task.low, task.high, (2 * LANES, len(task.low))))
            found += [episodes.observations(), episodes.rewards, episodes.torques]
    return b"".join(one.tobytes() for one in found)


def main() -> None:
    """Print the hash, and how many runs there were."""
    digest, count = hashlib.sha256(), 0
    for name in CONTROLLERS:
        plan = make_plan("fig8", name, ("profile_practical",), SETTINGS, {"update_rate": 1000.0})
        simulator = plan.simulator
        plans = [
            replace(plan, simulator=replace(simulator, trunk_mass=0.4 + 0.01 * i, seed=i))
            for i in range(LANES)
        ]
        runs = [regular_run(one) for one in plans]
        regular = [run for run in runs if run is not None]
        trace = np.zeros((regular[0].common.states, TRACED, LANES))
        for one in run_block(name, regular, trace):
            digest.update(repr(one).encode())
            count += one is not None
        digest.update(trace.tobytes())
    digest.update(environments())
    print(digest.hexdigest(), count)


if __name__ == "__main__":
    main()
