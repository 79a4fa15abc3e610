"""Compiled closed-loop runs against MuJoCo and scikit-fuzzy in Python loops.

Times depend on the machine, so we compare ratios of processor times that are taken alternately. The
libraries are optional and imported only here. MuJoCo must first give our motion on a flat path;
scikit-fuzzy defuzzifies differently, so only the ranges of its gains are checked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from trunk_control.fuzzy_pid import FuzzyPidConfig, fuzzy_pid_update
from trunk_control.law import Sample
from trunk_control.pid_family import PidState
from trunk_core.parameters.declarations import changed
from trunk_runs.plan import RunPlan
from trunk_studies.batch.block import summaries
from trunk_studies.batch.compiled_run import run_compiled

from .harness import BenchError, Row, library, timed
from .lanes import FEW, bench_plan, varied

MUJOCO_GOAL = 250.0
SCIKIT_GOAL = 10_000.0
MUJOCO_TOLERANCE = 1e-6  # rad, over one second on a flat path

_SCIKIT = "scikit-fuzzy", "--no-deps -r requirements/bench.txt"
_STEPS = 10_000  # 10 s at 1 kHz
_SCIKIT_STEPS = 20

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


def compare(rounds: int = 3) -> list[Row]:
    """Compare compiled closed-loop runs with MuJoCo's and scikit-fuzzy's in Python loops."""
    mujoco = library("mujoco", "MuJoCo", "--no-deps -r requirements/bench.txt")
    library("skfuzzy", *_SCIKIT)
    check_mujoco(mujoco)
    plan = bench_plan()
    few = varied(plan, FEW)
    summaries(few)
    scikit_step = _scikit_loop(plan)
    contenders: dict[str, Callable[[], float]] = {
        "ours": lambda: timed(partial(summaries, few)) / FEW,
        "mujoco": lambda: timed(partial(mujoco_run, mujoco, plan, "RK4", _STEPS)),
        "euler": lambda: timed(partial(mujoco_run, mujoco, plan, "Euler", _STEPS)),
        "scikit": lambda: timed(scikit_step) / _SCIKIT_STEPS * _STEPS,
    }
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, measure in contenders.items():
            times[name].append(measure())

    run, scaled = "Fuzzy-PID run, 10 s at 1 kHz", f"scaled from {_SCIKIT_STEPS} steps"
    rows = (
        (f"{run}, RK4: MuJoCo's time / ours", "mujoco", MUJOCO_GOAL),
        (f"{run}: time of MuJoCo's Euler / our RK4", "euler", None),
        (f"{run}: scikit-fuzzy's time, {scaled} / ours", "scikit", SCIKIT_GOAL),
    )
    return [
        Row.of(name, times["ours"], times[side], "ms", at_least=goal, inverse=True)
        for name, side, goal in rows
    ]


def check_mujoco(mujoco: Any) -> None:
    """Refuse a MuJoCo whose cart-pole does not move like our plant on a flat path."""
    plan = bench_plan()
    flat = replace(
        plan, simulator=changed(plan.simulator, {"path.amplitude": 0.0, "duration": 1.0})
    )
    ours = float(run_compiled(flat).table.theta[-1])
    theirs = mujoco_run(mujoco, flat, "RK4", 1000)
    if not abs(theirs - ours) <= MUJOCO_TOLERANCE:
        raise BenchError(f"after 1 s MuJoCo's trunk is at {theirs!r} rad, ours at {ours!r}")


def mujoco_run(mujoco: Any, plan: RunPlan, integrator: str, steps: int) -> float:
    """Return the trunk's last angle in rad of the same loop with MuJoCo's plant, the law in Python."""
    model = mujoco.MjModel.from_xml_string(
        MJCF.format(integrator=integrator, body=plan.simulator.constants)
    )
    data = mujoco.MjData(model)
    initial = plan.simulator.initial_state
    data.qpos[:] = initial.x, initial.theta
    data.qvel[:] = initial.x_dot, initial.theta_dot
    config = plan.controller
    if not isinstance(config, FuzzyPidConfig):
        raise TypeError("a Fuzzy-PID plan is needed")
    constants, limits = config.constants, config.limits
    state = PidState()
    for _ in range(steps):
        sample = Sample(0.0, data.qpos[1], data.qvel[1], 0.001)
        state, terms = fuzzy_pid_update(state, sample, constants, limits)
        data.ctrl[0] = terms.effort
        mujoco.mj_step(model, data)
    return float(data.qpos[1])


def _scikit_loop(plan: RunPlan) -> Callable[[], None]:
    """Return a loop of `_SCIKIT_STEPS` samples whose gains scikit-fuzzy infers, plant in Python."""
    from trunk_runs.engine import SEEN_POSITION, SEEN_VELOCITY, states_of_run

    config = plan.controller
    if not isinstance(config, FuzzyPidConfig):
        raise TypeError("a Fuzzy-PID plan is needed")
    simulation = scikit_simulation(config)
    short = replace(plan, simulator=replace(plan.simulator, duration=(_SCIKIT_STEPS - 1) * 0.001))

    def loop() -> None:
        (states,) = states_of_run(short, compiled=False)
        for row in states.table.tolist():
            simulation.input["e"] = -row[SEEN_POSITION][1]
            simulation.input["e_dot"] = -row[SEEN_VELOCITY][1]
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

    axes = config.axes
    inputs = []
    for name, span, labels in (
        ("e", config.error_range, axes.error),
        ("e_dot", config.rate_range, axes.rate),
    ):
        variable = control.Antecedent(np.linspace(-span, span, 121), name)
        variable.automf(names=list(labels))  # even triangles
        inputs.append(variable)
    outputs = []
    for table in config.tables:
        low, high = min(table.centers.values()), max(table.centers.values())
        variable = control.Consequent(np.linspace(low, high, 61), table.name)
        for label, center in table.centers.items():
            variable[label] = trimf(variable.universe, [center - 1.0, center, center + 1.0])
        outputs.append(variable)
    tables = [table.cells for table in config.tables]
    e, e_dot = inputs
    rules = [
        control.Rule(
            e[first] & e_dot[second],
            [variable[table[i][j]] for variable, table in zip(outputs, tables, strict=True)],
            and_func=np.multiply,
        )
        for i, first in enumerate(axes.error)
        for j, second in enumerate(axes.rate)
    ]
    return control.ControlSystemSimulation(control.ControlSystem(rules), cache=False)
