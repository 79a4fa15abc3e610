"""Random studies on a GPU and in lanes: every number of every run must have the same bits.

    python -m tests.gpu.check [STUDIES] [RUNS] [--cpp]

By default 200 random studies of 500 runs each. On the card they are made as they come, in small blocks of
threads, by texts that are compiled once more, and in parts as if its memory were small; the lanes run on all
cores. Then it times a million runs. ``--cpp``: g++ and the processor stand for the card, without the times.
"""

import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from ros2_ws.src.trunk_runs.test.random_plans import random_plan
from ros2_ws.src.trunk_studies.test.cpp_device import CppDevice

from trunk_core.parameters.declarations import changed, declarations, values_of
from trunk_runs.plan import RunPlan
from trunk_studies.batch.block import Lanes, Maker, Outcomes, make_runs
from trunk_studies.batch.cuda import CudaDevice
from trunk_studies.batch.kernel import OnDevice
from trunk_studies.batch.varied import Rows, Varied, each_run
from trunk_studies.batch.workers import as_completed_bounded, worker_pool
from trunk_studies.study import parse_study
from trunk_studies.sweep_execution import SweepJob, device_runner

_FIRST = 1000  # of the plans: none that a test draws
_MOST = 6  # numbers that vary in a study
_MILLION = """
scenario: demo
controllers: [fuzzy_pid]
runs: 1000000
vary:
  mass: {parameter: simulator.plant.trunk_mass, as: factor, distribution: uniform, low: 0.8, high: 1.2}
  angle: {parameter: "simulator.initial.position[1]", distribution: uniform, low: -0.5, high: 0.5}
  pulse: {parameter: disturbance.pulse.magnitude, as: factor, distribution: normal, mean: 1.0, std: 0.2}
"""


def study(index: int, runs: int) -> tuple[RunPlan, dict[str, dict[str, Any]]]:
    """Return a random plan, and for some of its numbers one value for each run."""
    plan = random_plan(_FIRST + index)
    draw = np.random.default_rng(index)
    names = [
        (node, name)
        for node, config in plan.configs.items()
        if node in ("simulator", "disturbance", plan.controller_name) and config is not None
        for name, declared in declarations(type(config)).items()
        if declared.kind == "double" and name not in ("update_rate", "duration")
        if np.isfinite(values_of(config)[name])
    ]
    varied: dict[str, dict[str, Any]] = {}
    for k in draw.permutation(len(names))[: draw.integers(1, _MOST + 1)]:
        node, name = names[k]
        value = values_of(plan.configs[node])[name]
        varied.setdefault(node, {})[name] = Varied(value * draw.uniform(0.7, 1.3, runs))
    if draw.integers(2):
        varied.setdefault("simulator", {})["sensor.seed"] = Varied(draw.integers(0, 2**31, runs))
    return plan, varied


def plan_of(plan: RunPlan, varied: dict[str, dict[str, Any]], rows: Rows) -> RunPlan:
    """Return the plan with the values of some rows; those of one as plain numbers."""
    configs = plan.configs
    for node, values in varied.items():
        chosen = {name: Varied(value.values[rows]) for name, value in values.items()}
        if len(rows) == 1:
            chosen = {name: next(iter(each_run(value, 1))) for name, value in chosen.items()}
        configs[node] = changed(configs[node], chosen)
    disturbance = configs.get("disturbance")
    return replace(
        plan,
        simulator=configs["simulator"],
        controllers={name: configs[name] for name in plan.controllers},
        disturbance=disturbance if plan.disturbance is not None else None,
    )


def outcomes(maker: Maker, index: int, runs: int) -> Outcomes:
    """Return the outcomes of a study's runs."""
    plan, varied = study(index, runs)
    ended = Outcomes(runs)
    make_runs(maker, partial(plan_of, plan, varied), [np.arange(runs)], ended)
    return ended


def in_lanes(given: tuple[int, int]) -> tuple[int, Outcomes]:
    """Return a study's number and its outcomes on the CPU."""
    return given[0], outcomes(Lanes(), *given)


def differing(a: Outcomes, b: Outcomes) -> int:
    """Return the number of runs that differ in any bit."""
    x, y = (np.vstack([ended.metrics, ended.diverged_at, ended.fell]) for ended in (a, b))
    differ = (x.view(np.int64) != y.view(np.int64)) & ~(np.isnan(x) & np.isnan(y))
    reasons = {
        i for i in a.refused.keys() | b.refused.keys() if a.refused.get(i) != b.refused.get(i)
    }
    return int(differ.any(axis=0).sum()) + len(reasons)


def devices(folder: Path, cpp: bool) -> Iterator[tuple[str, Any]]:
    """Yield the devices that must agree, each by what it does."""
    if cpp:
        yield "as it comes", CppDevice(folder)
        yield "blocks of 7 threads", CppDevice(folder, block=7)
        return
    yield "as it comes", CudaDevice()
    import cupy

    os.environ["CUPY_CACHE_DIR"] = str(folder)  # where nothing is kept yet, nor in memory
    cupy.clear_memo()
    yield "compiled again, blocks of 32 threads", CudaDevice(threads=32)
    yield "blocks of 256 threads", CudaDevice(threads=256)
    yield "in parts of 1 MB", CudaDevice(memory=1_000_000)
    del os.environ["CUPY_CACHE_DIR"]


@click.command()
@click.argument("studies", default=200)
@click.argument("runs", default=500)
@click.option("--cpp", is_flag=True)
def main(studies: int, runs: int, cpp: bool) -> None:
    """Compare, print what was compared, and time; exit code 1 if a run differs."""
    begun = time.perf_counter()
    work = [(index, runs) for index in range(studies)]
    with worker_pool(len(os.sched_getaffinity(0))) as pool:
        lanes = dict(as_completed_bounded(pool, in_lanes, work, 32))
    print(f"{studies} random studies of {runs} runs in lanes: {time.perf_counter() - begun:.0f} s")
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for words, device in devices(Path(folder), cpp):
            begun, left, differ, texts = time.perf_counter(), Counter[str](), 0, set[str]()
            for index in range(studies):
                maker = OnDevice(device)
                differ += differing(outcomes(maker, index, runs), lanes[index])
                left += maker.left
            texts |= set(device.texts)
            wrong += differ
            print(
                f"{words}: {studies * runs - left.total()} runs, {len(texts)} kernels, "
                f"{differ} differ, {time.perf_counter() - begun:.0f} s"
            )
        for why, count in sorted(left.items()):
            print(f"    {count} on the CPU: {why}")
    if not cpp:
        timed()
    sys.exit(wrong > 0)


def timed() -> None:
    """Print the seconds of a million runs, on the card alone and from the study to the file."""
    device = CudaDevice()
    maker = OnDevice(device)
    with tempfile.TemporaryDirectory() as folder:
        job = SweepJob(parse_study(_MILLION, "million"), Path(folder) / "million.parquet")
        begun = time.perf_counter()
        job.start()
        job.run(device_runner(maker))
        job.finish()
        whole = time.perf_counter() - begun
    print(
        f"{device.name}: 1,000,000 runs of 2,001 states: {device.seconds:.2f} s on the card, "
        f"{whole:.1f} s from the study to the file"
    )


if __name__ == "__main__":
    main()
