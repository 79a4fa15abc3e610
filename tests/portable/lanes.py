"""Prints a SHA-256 of many runs in lanes: every state, reference and torque, and the metrics.

NUMBA_CPU_NAME and NUMBA_CPU_FEATURES choose the instructions, and with them how many lanes go at a time.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from trunk_control.laws import CONTROLLERS
from trunk_experiments.batch.block import regular_run, run_block
from trunk_experiments.batch.columns import LANES
from trunk_experiments.batch.lanes import TRACED
from trunk_experiments.plans.plan import make_plan

SETTINGS = (
    "simulator.sensor.position_noise=0.003",
    "simulator.sensor.delay=0.002",
    "disturbance.sine.amplitude=0.3",
)


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
    print(digest.hexdigest(), count)


if __name__ == "__main__":
    main()
