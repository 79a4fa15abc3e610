"""The runs whose recordings are frozen: the plan of each by its name, how it runs, and what comes of it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from ros2_ws.src.trunk_runs.test.random_plans import links_and_drives, random_plan

from trunk_core import topics
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import Value, build, values_of
from trunk_core.topics import Event
from trunk_evidence.judgement import verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan, Swap, make_plan
from trunk_runs.timeline import Change
from trunk_sim.config import TrunkSimulator
from trunk_sim.inputs import Applied
from trunk_sim.simulation import DivergedError

from .contents import digests_of
from .features import FEATURES

REFUSED = "refused"  # the plan, instead of a verdict
LAWS = ("pid", "fuzzy_pid", "lqr", "computed_torque")
MS = 1_000_000
_RANDOM, _LINKED = 140, 40  # how many
_LOCKSTEP: Mapping[str, object] = {"duration": 0.1, "lockstep.enabled": True}

Plan = Callable[[], RunPlan]


class Fingerprint(NamedTuple):
    """What came of a run."""

    word: str  # of the verdict
    states: int
    digests: Mapping[str, str]  # by topic


def fingerprint(path: Path, graph: bool) -> Fingerprint:
    """Return what is frozen of a recording; ``graph``: nodes wrote it."""
    states = Recording.open(path).topics[f"/{topics.GROUND_TRUTH}"].count
    return Fingerprint(verdict_on(RecordedRun.open(path)).word, states, digests_of(path, graph))


def offline(name: str, folder: Path) -> Fingerprint:
    """Run a plan offline and return what came of it."""
    path = folder / "run.mcap"
    try:
        record_offline(OFFLINE[name](), path, overwrite=True)
    except PlanError:
        return Fingerprint(REFUSED, 0, {})
    except DivergedError:
        pass
    return fingerprint(path, graph=False)


def of_feature(law: str, feature: str, lockstep: bool = False) -> RunPlan:
    """Return a short run of a law with one feature."""
    settings = [setting.replace("LAW.", f"{law}.") for setting in FEATURES[feature]]
    everywhere: dict[str, object] = {"duration": 0.25, "update_rate": 200.0, "substeps": 3}
    if lockstep:
        everywhere |= _LOCKSTEP
    return make_plan("fig6", law, settings=settings, everywhere=everywhere)


def linked(index: int, lockstep: bool = False) -> RunPlan:
    """Return a run of random links and, often, a random drive and sensors."""
    rng = np.random.default_rng([2027, index])
    law = LAWS[index % len(LAWS)]
    scenario = ("demo", "fig8")[index // len(LAWS) % 2]
    everywhere: dict[str, object] = {"duration": float(rng.uniform(0.2, 0.5))}
    if lockstep:
        everywhere |= _LOCKSTEP
    plan = make_plan(scenario, law, everywhere=everywhere)
    values = {**values_of(plan.simulator), **links_and_drives(rng, plan.simulator.update_rate)}
    return replace(plan, simulator=build(TrunkSimulator, values))


# What may happen to a node; None: a reset.
_CHANGES: Mapping[str, Sequence[Mapping[str, Value] | None]] = {
    "simulator": (
        {"plant.length": 1.2},
        {"plant.trunk_mass": 0.7, "sensor.position_bias": 0.05},
        {"actuator.bias": 1.0},
        {"max_effort": 30.0},
        None,
    ),
    "disturbance": (
        {"pulse.magnitude": 0.4},
        {"sine.amplitude": 2.0, "sine.frequency": 9.0},
        {"noise.rms": 0.5},
    ),
    "controller": (
        {"reference.value": 0.3},
        {"derivative_filter_time": 0.01},
        {"handover.max_step": 0.5, "reference.profile": "constant"},
        None,
    ),
}


def changed(plan: RunPlan, index: int) -> RunPlan:
    """Return a plan with random changes and resets of its nodes during the run."""
    rng = np.random.default_rng([2029, index])
    steps = round(plan.simulator.duration * plan.simulator.update_rate)
    changes: dict[str, list[Change]] = {}
    for node in plan.configs:
        if node == "recorder" or rng.random() < 0.3:
            continue
        kinds = _CHANGES.get(node, _CHANGES["controller"])
        times = sorted(rng.integers(-1, steps, int(rng.integers(1, 4))).tolist())
        changes[node] = [
            Change(max(step * plan.simulator.period_ns, -1), kinds[int(rng.integers(len(kinds)))])
            for step in times
        ]
    return replace(plan, changes=changes)


def of_random(index: int) -> RunPlan:
    """Return a random plan; those with odd numbers are changed during the run."""
    plan = random_plan(index)
    return changed(plan, index) if index % 2 else plan


def swapped(law: str, *swaps: tuple[float, str]) -> RunPlan:
    """Return a run in which controllers take over by a schedule."""
    everywhere = {"duration": 0.4, "update_rate": 200.0}
    turns = [Swap(time, name) for time, name in swaps]
    return make_plan("fig8", law, everywhere=everywhere, swaps=turns)


def swapped_and_changed(law: str, other: str) -> RunPlan:
    """Return a run in which another controller takes over, with random changes of all nodes."""
    return changed(swapped(law, (0.2, other)), LAWS.index(law))


def by_hand(first: str, second: str, off_ms: int, on_ms: int) -> RunPlan:
    """Return a run in which somebody makes one controller inactive and another active."""
    everywhere = {"duration": 0.4, "update_rate": 200.0, "command_timeout": 0.05}
    plan, other = (make_plan("fig8", name, everywhere=everywhere) for name in (first, second))
    return replace(
        plan,
        controllers={
            **plan.controllers,
            second: replace(other.controller, autostart=on_ms == off_ms),
        },
        changes={
            first: [Change(off_ms * MS, None, Event.DEACTIVATED)],
            second: [Change(on_ms * MS, None, Event.ACTIVATED)],
        },
    )


def referred(law: str, late: bool) -> RunPlan:
    """Return a run whose reference comes by a topic, all the time or for a part of it."""
    settings = [] if late else [f"{law}.reference.profile=topic"]
    everywhere = {"duration": 0.3, "update_rate": 200.0}
    plan = make_plan("fig6", law, settings=settings, everywhere=everywhere)
    references = {k * 5 * MS: 0.05 * (k % 9) - 0.1 for k in range(5, 61)}
    changes = [Change(100 * MS, {"reference.profile": "topic"})]
    changes += [Change(200 * MS, {"reference.profile": "constant"})]
    return replace(plan, references=references, changes={law: changes} if late else {})


def pushed(law: str, *settings: str) -> RunPlan:
    """Return a run that an operator pushes, each time until the next push or for 40 ms."""
    everywhere = {
        "duration": 0.3,
        "update_rate": 200.0,
        "operator.force": 20.0,
        "operator.torque": 10.0,
        "operator.timeout": 0.04,
    }
    plan = make_plan("fig6", law, settings=settings, everywhere=everywhere)
    pushes = (
        (50 * MS, Applied(0.0, 6.0)),
        (75 * MS, Applied(12.5, -4.0)),
        (150 * MS, Applied(-20.0, 0.0)),
        (240 * MS, Applied(0.0, 10.0)),
    )
    return replace(plan, pushes=pushes)


def renamed(law: str) -> RunPlan:
    """Return a run whose joints have other names."""
    joints = "[sled, torso]"
    settings = [f"simulator.joints={joints}", f"disturbance.joints={joints}", f"{law}.joint=torso"]
    everywhere = {"duration": 0.2, "update_rate": 200.0}
    return make_plan("fig6", law, settings=settings, everywhere=everywhere)


def of_walking(law: str) -> RunPlan:
    """Return a run of the walking profile: 1 kHz, a prescribed hip, a torque limit."""
    return make_plan("fig6", law, params=["profile_walking"], everywhere={"duration": 0.1})


_SINGLE: Mapping[str, object] = {"duration": 41.0, "update_rate": 1000.0, "substeps": 1}


def long(
    scenario: str, law: str, *settings: str, swaps: Sequence[tuple[float, str]] = ()
) -> RunPlan:
    """Return a run of so many steps, each a single one of the plant's, that compiled code takes them."""
    turns = [Swap(time, name) for time, name in swaps]
    return make_plan(scenario, law, settings=settings, everywhere=_SINGLE, swaps=turns)


def long_changed(law: str) -> RunPlan:
    """Return a long run with changes and resets."""
    changes = {
        law: [Change(9_000 * MS, {"reference.value": 0.2}), Change(20_000 * MS, None)],
        "simulator": [Change(13_000 * MS, {"plant.length": 1.1}), Change(25_000 * MS, None)],
        "disturbance": [Change(4_000 * MS, {"pulse.magnitude": 0.6})],
    }
    return replace(long("demo", law), changes=changes)


_DIVERGING: Mapping[str, str] = {
    "pid": "gains.d=900.0",
    "lqr": "gains.d=900.0",
    "computed_torque": "gains.d=4000.0",
}


def diverging(law: str) -> RunPlan:
    """Return a run of an unstable loop."""
    settings = [f"{law}.{value}" for value in ("u_clamp_max=.inf", "u_clamp_min=-.inf")]
    settings.append(f"{law}.{_DIVERGING[law]}")
    everywhere = {"duration": 1.0, "update_rate": 200.0}
    return make_plan("fig6", law, settings=settings, everywhere=everywhere)


def in_lockstep(law: str, *swaps: tuple[float, str]) -> RunPlan:
    """Return a run as the seeds of the virtual world have it."""
    turns = [Swap(time, name) for time, name in swaps]
    return make_plan("demo", law, everywhere=_LOCKSTEP, swaps=turns)


def _offline() -> Iterator[tuple[str, Plan]]:
    for index in range(_RANDOM):
        yield f"random {index}", partial(of_random, index)
    for index in range(_LINKED):
        yield f"linked {index}", partial(linked, index)
    for number, feature in enumerate(FEATURES):
        first = number % 4  # each feature with two laws, each pair of laws in turn
        for law in (LAWS[first], LAWS[(first + 1 + number // 4 % 3) % 4]):
            yield f"{feature}, {law}", partial(of_feature, law, feature)
    yield from _special()
    yield from _long()


def _special() -> Iterator[tuple[str, Plan]]:
    """Yield runs with what a plan holds besides parameters."""
    for law, other in zip(LAWS, (*LAWS[1:], LAWS[0]), strict=True):
        yield f"swap, {law}", partial(swapped, law, (0.1, other), (0.25, law))
        yield f"changed swap, {law}", partial(swapped_and_changed, law, other)
        yield f"turns by hand, {law}", partial(by_hand, law, other, 145, 145)
        yield f"turns by hand with a gap, {law}", partial(by_hand, law, other, 100, 220)
        yield f"references, {law}", partial(referred, law, False)
        yield f"references for a while, {law}", partial(referred, law, True)
        yield f"pushes, {law}", partial(pushed, law)
        yield f"walking, {law}", partial(of_walking, law)
    yield "other joints", partial(renamed, "pid")
    turns = (0.1, "lqr"), (0.2, "computed_torque"), (0.3, "fuzzy_pid")
    yield "swaps among all", partial(swapped, "pid", *turns)
    yield "pushes over a lag", partial(pushed, "pid", *FEATURES["lag"])
    yield "pushes and random pulses", partial(pushed, "lqr", *FEATURES["random pulses"])
    yield "pushes over a bad link", partial(pushed, "fuzzy_pid", *FEATURES["bursts"])
    for law in _DIVERGING:
        yield f"diverging, {law}", partial(diverging, law)


def _long() -> Iterator[tuple[str, Plan]]:
    for law in LAWS:
        yield f"long, {law}", partial(long, "fig8", law)
    turns = (15.0, "fuzzy_pid"), (30.0, "pid")
    yield "long, swaps", partial(long, "fig9", "pid", swaps=turns)
    yield "long, changes", partial(long_changed, "fuzzy_pid")
    features = "noise", "sensor delay", "lag", "sine", "harmonics, prescribed"
    settings = [setting for feature in features for setting in FEATURES[feature]]
    yield "long, half the updates", partial(long, "fig6", "pid", *settings, "pid.update_rate=500.0")
    links = *FEATURES["uniform jitter"], *FEATURES["loss, hold"]
    yield "long, bad link", partial(long, "fig6", "lqr", *links)


_OF_GRAPH = (
    "state delay",
    "uniform jitter",
    "bursts",
    "loss, zero",
    "lag",
    "noise",
    "sensor delay",
    "dropout",
    "sine",
    "harmonics, prescribed",
    "half the updates",
    "fall that stops",
    "reference sine",
)


def _lockstep() -> Iterator[tuple[str, Plan]]:
    for law, other in zip(LAWS, (*LAWS[1:], LAWS[0]), strict=True):
        yield f"lockstep {law}", partial(in_lockstep, law)
        yield f"lockstep swap, {law}", partial(in_lockstep, law, (0.04, other))
        for feature in _OF_GRAPH:
            plan = partial(of_feature, law, feature, lockstep=True)
            yield f"lockstep {feature}, {law}", plan
    for index in range(8):
        yield f"lockstep linked {index}", partial(linked, index, lockstep=True)


OFFLINE: Mapping[str, Plan] = dict(_offline())
LOCKSTEP: Mapping[str, Plan] = dict(_lockstep())
