"""Runs a law by every path and prints how each differs from CPython: own_runs.py NAME, in an empty folder."""

import sys
from pathlib import Path

import gymnasium
import numpy as np

from trunk_core.errors import PlanError
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.conformance.law import CHECKS, findings_of
from trunk_experiments.gym import ENVIRONMENT
from trunk_runs.plan import RunPlan, make_plan
from trunk_studies.tuning.floquet import floquet

from .paths import IN_ONE_PROCESS, differences, reference

FILES = ["profile_practical"]
AT = {"duration": 1.0, "update_rate": 1000.0}
EVERY = 2  # states of an update


def settings(name: str) -> list[str]:
    noise = ["simulator.sensor.delay=0.004", "simulator.sensor.position_noise=0.001"]
    return [*noise, f"{name}.update_rate={AT['update_rate'] / EVERY}"]


def stepped(plan: RunPlan, run: RecordedRun, action: str) -> list[str]:
    """Step an environment through a run, by its commands or by its law's constants."""
    name = plan.controller_name
    given = {"settings": settings(name), "controller": name, "duration": AT["duration"]}
    env = gymnasium.make(
        ENVIRONMENT, scenario="fig6", params=FILES, rate=AT["update_rate"], action=action, **given
    )
    env.reset(options={"as_planned": True})
    efforts = run.table(f"{name}/state").column("position", "effort")
    angles = run.table("ground_truth").column("position", "trunk")
    for k in range(0, len(angles) - 1, EVERY):
        taken = [efforts[k // EVERY]] if action == "torque" else plan.controller.constants
        *_, info = env.step(np.array(taken))
        if info["angle"] != angles[k + EVERY]:
            return [f"state {k + EVERY}: {info['angle']}, {angles[k + EVERY]} expected"]
    return []


def main(name: str) -> None:
    folder = Path.cwd()
    plan = make_plan("fig6", name, FILES, settings(name), AT)
    run = reference(plan, folder)
    for path in IN_ONE_PROCESS:
        print(path, differences(path, plan, run, folder))
    for action in ("torque", "gains"):
        try:
            print(action, stepped(plan, run, action))
        except PlanError as error:
            print(action, error)
    print("floquet", floquet(plan).growth < 1.0)
    print("check", [one.line() for check in CHECKS for one in findings_of(name, check)])


if __name__ == "__main__":
    main(sys.argv[1])
