"""Compiled closed-loop runs against MuJoCo and scikit-fuzzy in Python loops; how runs and cores scale.

Times depend on the machine, so ratios are compared, of times taken alternately: processor time for one
process, wall time for two. The libraries are optional and imported only here. MuJoCo must first give our
motion on a flat path; scikit-fuzzy defuzzifies differently, so only the ranges of its gains are checked.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from statistics import median
from time import perf_counter, process_time, sleep
from typing import Any

import numpy as np

from trunk_control import rule_tables
from trunk_control.fuzzy_pid import fuzzy_pid_update
from trunk_control.fuzzy_pid_law import FuzzyPidConfig
from trunk_control.pid import PidState

from ..batch.closed_loop import Batch
from ..batch.workers import worker_pool
from ..errors import BenchError
from ..plans.plan import RunPlan, make_plan
from .core import BenchRow, library

MUJOCO_GOAL = 40.0
SCIKIT_GOAL = 10_000.0
LINEAR_GOAL = 1.15  # at most: cost per run of many over that of few
CORES_GOAL = 1.8
MUJOCO_TOLERANCE = 1e-6  # rad, over one second on a flat path

_SCIKIT = "scikit-fuzzy", "--no-deps -r requirements/bench.txt"
_STEPS = 10_000  # 10 s at 1 kHz
_SCIKIT_STEPS = 20
_FEW, _MANY = 20, 80  # runs

# A cart-pole of the trunk's size: point masses, no friction, no contacts.
MJCF = """
<mujoco>
  <option timestep="0.001" gravity="0 0 -{body.gravity}" integrator="{integrator}">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
    <body name="hip">
      <joint name="hip" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{body.hip_mass}" diaginertia="1e-9 1e-9 1e-9"/>
      <body name="trunk">
        <joint name="trunk" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 {body.length}" mass="{body.trunk_mass}" diaginertia="1e-9 1e-9 1e-9"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="trunk"/>
  </actuator>
</mujoco>
"""


def bench_sweep(rounds: int = 3) -> list[BenchRow]:
    """Return the comparisons. Raises BenchError if a library is missing or its results differ from ours."""
    if rounds < 1:
        raise ValueError(f"rounds must be 1 or greater, not {rounds!r}")
    mujoco = library("mujoco", "MuJoCo", "--no-deps -r requirements/bench.txt")
    library("skfuzzy", *_SCIKIT)
    check_mujoco(mujoco)
    plan, batch = bench_plan(), Batch()
    batch.run(plan)
    scikit_step = _scikit_loop(plan)
    contenders: dict[str, Callable[[], float]] = {
        "ours": lambda: _timed(partial(_runs, batch, plan, _FEW)) / _FEW,
        "many": lambda: _timed(partial(_runs, batch, plan, _MANY)) / _MANY,
        "mujoco": lambda: _timed(partial(mujoco_run, mujoco, plan, "RK4", _STEPS)),
        "euler": lambda: _timed(partial(mujoco_run, mujoco, plan, "Euler", _STEPS)),
        "scikit": lambda: _timed(scikit_step) / _SCIKIT_STEPS * _STEPS,
    }
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, measure in contenders.items():
            times[name].append(measure())

    def row(name: str, theirs: str, goal: float | None) -> BenchRow:
        ratio = median(a / b for a, b in zip(times[theirs], times["ours"], strict=True))
        met = None if goal is None else ratio >= goal
        text = "" if goal is None else f">= {goal:g}"
        return BenchRow(name, median(times["ours"]), median(times[theirs]), ratio, text, met)

    growth = median(a / b for a, b in zip(times["many"], times["ours"], strict=True))
    run = "Fuzzy-PID run, 10 s at 1 kHz"
    return [
        row(f"{run}, RK4: MuJoCo's time / ours", "mujoco", MUJOCO_GOAL),
        row(f"{run}: time of MuJoCo's Euler / our RK4", "euler", None),
        row(
            f"{run}: scikit-fuzzy's time, scaled from {_SCIKIT_STEPS} steps / ours",
            "scikit",
            SCIKIT_GOAL,
        ),
        BenchRow(
            f"cost of one run among {_MANY} (ours) / among {_FEW} (theirs)",
            median(times["many"]),
            median(times["ours"]),
            growth,
            f"<= {LINEAR_GOAL:g}",
            growth <= LINEAR_GOAL,
        ),
        cores_row(plan, rounds),
    ]


def bench_plan() -> RunPlan:
    """Return the run that is timed: Fig. 6, Fuzzy-PID, 10 s at 1 kHz, one RK4 step per period."""
    return make_plan("fig6", "fuzzy_pid", settings=["simulator.substeps=1"])


def check_mujoco(mujoco: Any) -> None:
    """Refuse a MuJoCo whose cart-pole does not move like our plant on a flat path."""
    plan = bench_plan()
    flat = replace(plan, simulator=replace(plan.simulator, amplitude=0.0, duration=1.0))
    ours = float(Batch().run(flat).table.theta[-1])
    theirs = mujoco_run(mujoco, flat, "RK4", 1000)
    if not abs(theirs - ours) <= MUJOCO_TOLERANCE:
        raise BenchError(f"after 1 s MuJoCo's trunk is at {theirs!r} rad, ours at {ours!r}")


def mujoco_run(mujoco: Any, plan: RunPlan, integrator: str, steps: int) -> float:
    """Return the trunk's last angle in rad of the same loop with MuJoCo's plant, the law in Python."""
    model = mujoco.MjModel.from_xml_string(
        MJCF.format(integrator=integrator, body=plan.simulator.body)
    )
    data = mujoco.MjData(model)
    initial = plan.simulator.initial_state
    data.qpos[:] = initial.x, initial.theta
    data.qvel[:] = initial.x_dot, initial.theta_dot
    config = plan.controller
    if not isinstance(config, FuzzyPidConfig):
        raise TypeError("a Fuzzy-PID plan is needed")
    rules, box, law = config.rules, config.box, config.law
    state = PidState()
    for _ in range(steps):
        state, terms = fuzzy_pid_update(
            state, 0.0, data.qpos[1], data.qvel[1], 0.001, rules, box, law
        )
        data.ctrl[0] = terms.effort
        mujoco.mj_step(model, data)
    return float(data.qpos[1])


def _scikit_loop(plan: RunPlan) -> Callable[[], None]:
    """Return a loop of `_SCIKIT_STEPS` samples whose gains scikit-fuzzy infers, plant in Python."""
    from ..runs.offline import steps

    config = plan.controller
    if not isinstance(config, FuzzyPidConfig):
        raise TypeError("a Fuzzy-PID plan is needed")
    simulation = scikit_simulation(config)

    def loop() -> None:
        for k, step in enumerate(steps(plan)):
            if k == _SCIKIT_STEPS:
                return
            simulation.input["e"] = -step.measured.position[1]
            simulation.input["e_dot"] = -step.measured.velocity[1]
            simulation.compute()
            if not 0.0 <= simulation.output["kp"] <= 1.0:
                raise BenchError(
                    f"scikit-fuzzy's Kp' is {simulation.output['kp']!r}: not in [0, 1]"
                )

    return loop


def scikit_simulation(config: FuzzyPidConfig) -> Any:
    """Return scikit-fuzzy's simulation of the same 49 rules: triangles, products, three outputs."""
    trimf = library("skfuzzy", *_SCIKIT).trimf
    control = library("skfuzzy.control", *_SCIKIT)

    labels = rule_tables.INPUT_LABELS
    inputs = []
    for name, span in (("e", config.error_range), ("e_dot", config.rate_range)):
        variable = control.Antecedent(np.linspace(-span, span, 121), name)
        variable.automf(names=list(labels))  # even triangles
        inputs.append(variable)
    alphas = dict(zip(rule_tables.ALPHA_LABELS, config.alpha_centers, strict=True))
    outputs = []
    for name, centers in (
        ("kp", rule_tables.GAIN_CENTERS),
        ("kd", rule_tables.GAIN_CENTERS),
        ("alpha", alphas),
    ):
        low, high = min(centers.values()), max(centers.values())
        variable = control.Consequent(np.linspace(low, high, 61), name)
        for label, center in centers.items():
            variable[label] = trimf(variable.universe, [center - 1.0, center, center + 1.0])
        outputs.append(variable)
    tables = [
        [row.split() for row in rows]
        for rows in (config.rules_kp, config.rules_kd, config.rules_alpha)
    ]
    e, e_dot = inputs
    rules = [
        control.Rule(
            e[first] & e_dot[second],
            [variable[table[i][j]] for variable, table in zip(outputs, tables, strict=True)],
            and_func=np.multiply,
        )
        for i, first in enumerate(labels)
        for j, second in enumerate(labels)
    ]
    return control.ControlSystemSimulation(control.ControlSystem(rules), cache=False)


def cores_row(plan: RunPlan, rounds: int) -> BenchRow:
    """Return how much faster two processes are than one; without two cores, for information only."""
    times: dict[int, list[float]] = {1: [], 2: []}
    with worker_pool(1) as one, worker_pool(2) as two:
        pools = {1: one, 2: two}
        for count, pool in pools.items():
            _warm_up(pool, plan, count)
        for _ in range(rounds):
            for count, pool in pools.items():
                times[count].append(_pool_time(pool, plan, count, 2 * _MANY))
    ratio = median(a / b for a, b in zip(times[1], times[2], strict=True))
    met = ratio >= CORES_GOAL if len(os.sched_getaffinity(0)) > 1 else None
    return BenchRow(
        f"{2 * _MANY} runs: one core's time (theirs) / two cores' (ours)",
        median(times[2]),
        median(times[1]),
        ratio,
        f">= {CORES_GOAL:g}",
        met,
    )


def _warm_up(pool: Executor, plan: RunPlan, count: int) -> None:
    """Wait until every process of a pool has loaded its code."""
    seen: set[int] = set()
    while len(seen) < count:
        seen |= {done.result() for done in [pool.submit(_warm, plan) for _ in range(2 * count)]}


def _warm(plan: RunPlan) -> int:
    _runs(Batch(), plan, 1)
    sleep(0.05)  # leaves work to the other process
    return os.getpid()


def _pool_time(pool: Executor, plan: RunPlan, count: int, runs: int) -> float:
    start = perf_counter()
    parts = 4 * count
    for done in [pool.submit(_pool_runs, plan, -(-runs // parts)) for _ in range(parts)]:
        done.result()
    return perf_counter() - start


def _pool_runs(plan: RunPlan, runs: int) -> None:
    _runs(Batch(), plan, runs)


def _runs(batch: Batch, plan: RunPlan, runs: int) -> None:
    for _ in range(runs):
        batch.run(plan)


def _timed(work: Callable[[], object]) -> float:
    start = process_time()
    work()
    return process_time() - start
