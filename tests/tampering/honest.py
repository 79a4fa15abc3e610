"""Random honest runs, which `trunk verify` must not accuse: offline, in lock-step and in real time."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from ros2_ws.src.trunk_runs.test.random_plans import STEPS, Draw, random_plan

from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import ParameterError, Value, build, declarations, values_of
from trunk_evidence.judgement import VERIFIED, Verdict, describe, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan
from trunk_runs.timeline import Change
from trunk_sim.simulation import DivergedError

from ..honest.oracle import contradictions
from .graph_runs import Action, for_graph, pause, reset, retune, run, transition


class Run(NamedTuple):
    """An honest run and what `verify` says of it."""

    name: str
    complete: bool
    verdict: Verdict
    contradictions: Sequence[str] = ()  # of what our nodes and recorder write in two places

    @property
    def accused(self) -> str:
        """What a run is wrongly accused of; empty: nothing."""
        v = self.verdict
        found = [*v.altered, *self.contradictions]
        found += [f"{part.name}: {describe(part.first[0])}" for part in v.checks if part.first]
        if self.complete and v.exit_code != VERIFIED:
            found += v.obstacles
        return "; ".join(found)


def offline_runs(count: int, folder: Path) -> Iterator[Run]:
    """Run random plans offline, with random changes and resets; every tenth is run again as recorded."""
    done, index = 0, 0
    while done < count:
        index += 1
        rng = np.random.default_rng([7, index])
        plan = random_plan(index)
        plan = replace(plan, changes=_changes(plan, rng))
        path = folder / "run.mcap"
        name = f"offline {index}"
        try:
            record_offline(plan, path, overwrite=True)
        except PlanError:
            continue
        except DivergedError:
            pass
        done += 1
        one = judged(name, path)
        yield one
        if done % 10 == 0 and one.complete and done < count:
            again = folder / "again.mcap"
            record_offline(RecordedRun.open(path).plan(), again, overwrite=True)
            done += 1
            yield judged(f"{name}, again", again)


def graph_runs(count: int, folder: Path, lockstep: bool) -> Iterator[Run]:
    """Run random plans in a graph, with changes, resets, pauses and lifecycle transitions."""
    for index in range(count):
        rng = np.random.default_rng([8, lockstep, index])
        plan = _graph_plan(index, rng, lockstep)
        path = folder / f"{'lockstep' if lockstep else 'real_time'}_{index}.mcap"
        path.unlink(missing_ok=True)
        run(plan, path, list(_actions(plan, rng)))
        kind = "lock-step" if lockstep else "real time"
        yield judged(f"{kind} {index}", path)


def judged(name: str, path: Path) -> Run:
    run = RecordedRun.open(path, whole=True)
    verdict = verdict_on(run)
    found = contradictions(run) if run.recording.complete and verdict.checks else []
    return Run(name, run.recording.complete, verdict, found)


def _graph_plan(index: int, rng: np.random.Generator, lockstep: bool) -> RunPlan:
    """Return a random plan that a graph can run: with an end, and in real time not too fast."""
    while True:
        plan = random_plan(10_000 + index)
        index += 1_000
        if not lockstep and plan.simulator.update_rate > 1000.0:
            continue
        # Half of the runs in lock-step are paced, so that what is done in them falls between states.
        speed = float(rng.choice([0.0, 1.0])) if lockstep else 0.0
        return for_graph(plan, lockstep, speed)


def random_values(config: object, rng: np.random.Generator, duration: float) -> Mapping[str, Value]:
    """Return some random values of a configuration that can change, allowed together; maybe none."""
    draw = Draw(rng, duration)
    declared = [d for d in declarations(type(config)).values() if not d.fixed]
    chosen = rng.choice(len(declared), size=min(3, len(declared)), replace=False)
    now = values_of(config)
    values = {declared[i].name: draw.value(declared[i]) for i in chosen}
    values = {name: value for name, value in values.items() if value != now[name] and value != ()}
    if values.get("reference.profile") == "topic":
        return {}
    try:
        build(type(config), {**now, **values})
    except ParameterError:
        return {}
    return values


def _changes(plan: RunPlan, rng: np.random.Generator) -> dict[str, list[Change]]:
    """Return random changes of parameters and resets during a run."""
    found: dict[str, list[Change]] = {}
    for node, config in plan.configs.items():
        if node == "recorder" or rng.random() < 0.3:
            continue
        changes = []
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(-1, STEPS)) * plan.simulator.period_ns
            stamp_ns = max(at, -1)
            if node != "disturbance" and rng.random() < 0.3:
                changes.append(Change(stamp_ns, None))
                continue
            values = random_values(config, rng, plan.simulator.duration)
            if values:
                config = build(type(config), {**values_of(config), **values})
                changes.append(Change(stamp_ns, values))
        stamps = sorted(change.stamp_ns for change in changes)
        found[node] = [
            replace(change, stamp_ns=stamp) for change, stamp in zip(changes, stamps, strict=True)
        ]
    return {node: changes for node, changes in found.items() if changes}


def _actions(plan: RunPlan, rng: np.random.Generator) -> Iterator[Action]:
    duration_ns = round(plan.simulator.duration * 1e9)

    def sometime() -> int:
        return int(rng.integers(-1, max(duration_ns, 1)))

    for node, changes in _changes(plan, rng).items():
        for change in changes:
            if change.values is not None:
                yield retune(change.stamp_ns, node, change.values)
            else:
                yield reset(change.stamp_ns, node)
    if rng.random() < 0.5:
        at = sometime()
        yield pause(at, True)
        yield pause(at, False)
    if rng.random() < 0.4:
        yield from _held(plan, rng, sometime())


def _held(plan: RunPlan, rng: np.random.Generator, at: int) -> Iterator[Action]:
    """Yield transitions of the simulator, with a change while it is inactive; or, in real time, of others."""
    yield transition(at, "simulator", "deactivate")
    values = random_values(plan.simulator, rng, plan.simulator.duration)
    if values:
        yield retune(at, "simulator", values)
    if rng.random() < 0.5:
        yield reset(at, "simulator")
    yield transition(at, "simulator", "activate")
    if plan.simulator.lockstep:
        return
    node = str(rng.choice([plan.controller_name, *(["disturbance"] if plan.disturbance else [])]))
    if len(plan.controllers) == 1 or node == "disturbance":
        yield transition(at, node, "deactivate")
        values = random_values(plan.configs[node], rng, plan.simulator.duration)
        if values:
            yield retune(at, node, values)
        if rng.random() < 0.3 and node != "disturbance":
            yield transition(at, node, "cleanup")
            yield transition(at, node, "configure")
        yield transition(at, node, "activate")
