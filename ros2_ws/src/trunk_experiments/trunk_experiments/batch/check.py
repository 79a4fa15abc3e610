"""Random runs, stepped by CPython and by compiled code: whether every number has the same bits."""

from __future__ import annotations

import numpy as np

from trunk_control.controller_config import ANTIWINDUP_STRATEGIES, DERIVATIVE_MODES
from trunk_control.reference import PROFILES
from trunk_msgs_util.parameters.declarations import build
from trunk_msgs_util.units import NANOSECONDS
from trunk_sim.disturbances import CHANNELS
from trunk_sim.simulation import DivergedError

from ..plans.nodes import CONTROLLERS, NODES
from ..plans.plan import RunPlan, make_plan
from ..runs.offline import Step, steps
from .closed_loop import Batch, Outcome

_STEPS = 250


def random_plan(index: int) -> RunPlan:
    """Return the index-th random plan: every parameter that decides a run is drawn, some runs diverge."""
    rng = np.random.default_rng([1963, index])
    uniform = rng.uniform

    def pick(*values: str) -> str:
        return str(rng.choice(values))

    def vector(low: float, high: float, count: int) -> list[float]:
        return [float(value) for value in uniform(low, high, count)]

    def sometimes(value: float, instead: float) -> float:
        return float(value) if rng.random() < 0.5 else instead

    rate = float(rng.choice([60.0, 200.0, 333.0, 1000.0, 4000.0]))
    duration = _STEPS / rate
    simulator = {
        "update_rate": rate,
        "duration": duration,
        "substeps": int(rng.integers(1, 5)),
        "plant.hip_mass": float(uniform(0.5, 80.0)),
        "plant.trunk_mass": float(uniform(0.2, 40.0)),
        "plant.length": float(uniform(0.2, 1.5)),
        "plant.gravity": float(uniform(1.0, 20.0)),
        "path.amplitude": float(uniform(-1.0, 1.0)),
        "path.wavenumber": float(uniform(0.0, 9.0)),
        "hip.mode": pick("passive", "passive", "prescribed"),
        "initial.position": vector(-2.0, 2.0, 2),
        "initial.velocity": vector(-3.0, 3.0, 2),
        "max_effort": sometimes(uniform(5.0, 200.0), float("inf")),
        "sensor.position_noise": sometimes(uniform(0.0, 0.1), 0.0),
        "sensor.velocity_noise": sometimes(uniform(0.0, 0.5), 0.0),
        "sensor.position_bias": sometimes(uniform(-0.1, 0.1), 0.0),
        "sensor.velocity_bias": sometimes(uniform(-0.1, 0.1), 0.0),
        "sensor.delay": sometimes(uniform(0.0, 12.0 / rate), 0.0),
        "sensor.seed": int(rng.integers(2**31)),
    }
    disturbance = {
        **{f"{signal}.channel": pick(*CHANNELS) for signal in ("pulse", "sine", "noise")},
        "pulse.start_times": vector(0.0, duration, int(rng.integers(4))),
        "pulse.duration": float(uniform(0.0, 0.3 * duration)),
        "pulse.magnitude": float(uniform(-2.0, 2.0)),
        "sine.amplitude": sometimes(uniform(0.0, 1.0), 0.0),
        "sine.frequency": float(uniform(0.1, 9.0)),
        "sine.phase": float(uniform(-3.0, 3.0)),
        "noise.rms": sometimes(uniform(0.0, 1.0), 0.0),
        "noise.components": int(rng.integers(1, 9)),
        "noise.seed": int(rng.integers(2**31)),
    }
    limit = sometimes(uniform(5.0, 100.0), float("inf"))
    i_limit = sometimes(uniform(1.0, 50.0), float("inf"))
    controller = {
        "update_rate": rate / int(rng.integers(1, 6)),
        "reference.profile": pick(*PROFILES),
        "reference.value": float(uniform(-1.0, 1.0)),
        "reference.initial": float(uniform(-1.0, 1.0)),
        "reference.step_time": float(uniform(0.0, duration)),
        "reference.amplitude": float(uniform(-1.0, 1.0)),
        "reference.frequency": float(uniform(0.0, 5.0)),
        "reference.times": sorted(vector(0.0, duration, 3)),
        "reference.values": vector(-1.0, 1.0, 3),
        "derivative_mode": pick(*DERIVATIVE_MODES),
        "derivative_filter_time": sometimes(uniform(0.0, 0.05), 0.0),
        "u_clamp_max": limit,
        "u_clamp_min": -limit,
        "i_clamp_max": i_limit,
        "i_clamp_min": -i_limit,
        "antiwindup_strategy": pick(*ANTIWINDUP_STRATEGIES),
        "tracking_time_constant": sometimes(uniform(0.0, 0.5), 0.0),
    }
    name = pick(*CONTROLLERS)
    if name != "fuzzy_pid":
        controller.update({f"gains.{gain}": float(uniform(0.0, 400.0)) for gain in "pid"})
    else:
        controller["fuzzy.consequents"] = pick("linear", "log")
        controller["gains.p_max"] = float(uniform(40.0, 400.0))
        controller["gains.d_max"] = float(uniform(10.0, 60.0))
    disturbed = build(NODES["disturbance"].config, disturbance)
    return RunPlan(
        scenario=f"random {index}",
        simulator=build(NODES["simulator"].config, simulator),
        controllers={name: build(NODES[name].config, controller)},
        disturbance=disturbed if disturbed.active else None,
        recorder=make_plan("demo", name).recorder,
    )


def first_difference(plan: RunPlan, batch: Batch) -> str | None:
    """Return where compiled and interpreted runs of a plan part, None where all bits are equal."""
    outcome = batch.run(plan)
    taken: list[Step] = []
    diverged = False
    try:
        taken.extend(steps(plan))
    except DivergedError:
        diverged = True
    if len(taken) != len(outcome.table.t) or diverged != (outcome.diverged_at is not None):
        return (
            f"{plan.scenario}: {len(outcome.table.t)} finite states compiled, "
            f"{len(taken)} interpreted"
        )
    return _table_difference(plan, outcome, taken)


def _table_difference(plan: RunPlan, outcome: Outcome, taken: list[Step]) -> str | None:
    table, limit = outcome.table, plan.simulator.max_effort
    held = [float("nan")] * 5
    columns: list[list[float]] = []
    for step in taken:
        terms = step.answer.terms
        if step.answer.fresh:
            held = [step.answer.reference, terms.kp, terms.ki, terms.kd, terms.alpha]
        torque = min(max(step.answer.effort, -limit), limit)
        columns.append(
            [
                step.stamp_ns / NANOSECONDS,
                *step.truth.position,
                *step.truth.velocity,
                step.measured.position[1],
                held[0],
                torque,
                *held[1:],
            ]
        )
    expected = np.array(columns).T
    actual = np.array([getattr(table, name) for name in table.__dataclass_fields__])
    wrong = np.argwhere(expected.view(np.int64) != actual.view(np.int64))
    if not len(wrong):
        return None
    step_index = int(wrong[:, 1].min())
    row = int(wrong[wrong[:, 1] == step_index][0, 0])
    name = list(table.__dataclass_fields__)[row]
    return (
        f"{plan.scenario}: step {step_index}: {name} is {float(actual[row, step_index])!r} compiled, "
        f"{float(expected[row, step_index])!r} interpreted"
    )
