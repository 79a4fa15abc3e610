"""Runs on a GPU against our lanes on all cores, and against MuJoCo's MJX on the same card.

MJX simulates a cart-pole of the trunk's size with a PID, without hip path, noise or disturbances: less than
our loop does. Rates are RK4 steps per second of wall time.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from trunk_core.parameters.declarations import changed
from trunk_runs.loop import states_of
from trunk_runs.plan import RunPlan, make_plan
from trunk_studies.batch.block import Lanes, Maker, Outcomes
from trunk_studies.batch.cuda import CudaDevice
from trunk_studies.batch.kernel import OnDevice
from trunk_studies.batch.varied import Varied
from trunk_studies.batch.workers import worker_pool

from .harness import BenchError, Row, library
from .sweep import MJCF

ON_CARD, IN_LANES, IN_MJX = 1_000_000, 2_000, 262_144  # runs
_MJX_STEPS = 200


def compare(rounds: int = 3) -> list[Row]:
    """Compare RK4 steps a second: ours on the card, our lanes on all cores, MJX in float64 on the card."""
    device = CudaDevice()
    plan = make_plan("demo", "fuzzy_pid")
    steps = (states_of(plan) - 1) * plan.simulator.substeps
    cores = len(os.sched_getaffinity(0))
    works: dict[str, tuple[int, Callable[[], object]]] = {
        "card": (ON_CARD * steps, partial(made, OnDevice(device), ON_CARD))
    }
    try:
        works["MJX"] = IN_MJX * _MJX_STEPS, _mjx(plan)
    except BenchError as error:
        print(f"without MJX: {error}")
    with worker_pool(cores) as pool:
        works["lanes"] = (
            cores * IN_LANES * steps,
            lambda: list(pool.map(in_lanes, [IN_LANES] * cores)),
        )
        rates: dict[str, list[float]] = {name: [] for name in works}
        for each in range(rounds + 1):
            for name, (count, work) in works.items():
                begun = perf_counter()
                work()
                if each:  # in the first round all are compiled
                    rates[name].append(count / (perf_counter() - begun))
    names = {"lanes": f"our lanes on {cores} cores", "MJX": "MJX, float64"}
    return [
        Row.of(f"{device.name}, Fuzzy-PID / {names[name]}", rates["card"], rates[name], "steps/s")
        for name in rates
        if name != "card"
    ]


def made(maker: Maker, runs: int) -> Outcomes:
    """Return the outcomes of so many runs from different angles, with different pulses."""
    plan = make_plan("demo", "fuzzy_pid")
    angles, pulses = np.linspace(-0.5, 0.5, runs), np.linspace(0.1, 2.0, runs)
    simulator = changed(plan.simulator, {"initial.position[1]": Varied(angles)})
    disturbance = changed(plan.disturbance, {"pulse.magnitude": Varied(pulses)})
    outcomes = Outcomes(runs)
    varied = replace(plan, simulator=simulator, disturbance=disturbance)
    maker.finish([(np.arange(runs), maker.prepared(varied))], lambda i: plan, outcomes)
    return outcomes


def in_lanes(runs: int) -> None:
    """Make the runs in this process's lanes."""
    made(Lanes(), runs)


def _mjx(plan: RunPlan) -> Callable[[], object]:
    """Return a function that simulates MJX's cart-poles with a PID. Raises BenchError without MJX."""
    mujoco: Any = library("mujoco", "MuJoCo", "mujoco-mjx 'jax[cuda12]'")
    mjx: Any = library("mujoco.mjx", "MJX", "mujoco-mjx 'jax[cuda12]'")
    jax: Any = library("jax", "JAX", "mujoco-mjx 'jax[cuda12]'")
    jax.config.update("jax_enable_x64", True)
    model = mujoco.MjModel.from_xml_string(
        MJCF.format(integrator="RK4", body=plan.simulator.constants)
    )
    on_card = mjx.put_model(model)
    start = mjx.make_data(model)
    dt = float(model.opt.timestep)

    def run(theta: Any) -> Any:
        def step(carry: Any, _: Any) -> Any:
            data, integral, before = carry
            error = -data.qpos[1]
            integral = integral + error * dt
            effort = 60.0 * error + 100.0 * integral + 9.0 * (error - before) / dt
            data = mjx.step(on_card, data.replace(ctrl=effort.clip(-100.0, 100.0)[None]))
            return (data, integral, error), None

        first = start.replace(qpos=jax.numpy.array([0.0, 0.0]).at[1].set(theta))
        (data, _, _), _ = jax.lax.scan(step, (first, 0.0 * theta, -theta), None, length=_MJX_STEPS)
        return data.qpos

    runs = jax.jit(jax.vmap(run))
    angles = jax.numpy.linspace(-0.5, 0.5, IN_MJX)
    return lambda: jax.block_until_ready(runs(angles))
