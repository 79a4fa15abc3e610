"""The recordings that are tampered with: an offline run, one in lock-step and one in real time.

Each has a swap from fuzzy PID to PID, sensor noise and delay, a pulse, changes of parameters, resets and a
fall; those of the graph have a pause too.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from trunk_core.parameters.declarations import Value
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan, Swap, make_plan
from trunk_runs.timeline import Change

OFFLINE, LOCKSTEP, REAL_TIME = "offline", "lockstep", "real_time"
BASES = (OFFLINE, LOCKSTEP, REAL_TIME)

# What changes when, as a part of the run, for every base.
_RETUNED: tuple[tuple[float, str, Mapping[str, Value]], ...] = (
    (0.2, "fuzzy_pid", {"gains.p_max": 80.0}),
    (0.6, "simulator", {"plant.length": 1.1}),
    (0.5, "disturbance", {"pulse.magnitude": 0.4}),
)
_RESET = ((0.3, "fuzzy_pid"), (0.8, "simulator"))


def base_plan(duration: float, rate: float = 500.0) -> RunPlan:
    """Return the plan of a base; the durations of its parts are in proportion."""
    at = duration
    plan = make_plan(
        "fig8",
        "fuzzy_pid",
        everywhere={"duration": duration, "update_rate": rate},
        swaps=[Swap(0.4 * at, "pid"), Swap(0.7 * at, "fuzzy_pid")],
        settings=[
            "simulator.sensor.position_noise=0.001",
            "simulator.sensor.velocity_noise=0.002",
            f"simulator.sensor.delay={2.0 / rate}",
            "simulator.fall.angle=0.5",
            "simulator.substeps=1",
            f"disturbance.pulse.start_times=[{0.45 * at}]",
            f"disturbance.pulse.duration={0.2 * at}",
            "disturbance.noise.rms=0.05",
            "fuzzy_pid.reference.profile=sine",
            "fuzzy_pid.reference.amplitude=0.2",
            "fuzzy_pid.reference.frequency=1.3",
        ],
    )
    return replace(plan, scenario="base")


def make_base(name: str, path: Path, duration: float) -> None:
    """Record a base."""
    plan = base_plan(duration)
    if name == OFFLINE:
        changes: dict[str, list[Change]] = {}
        for share, node, values in _RETUNED:
            changes.setdefault(node, []).append(Change(_ns(share * duration), values))
        for share, node in _RESET:
            changes.setdefault(node, []).append(Change(_ns(share * duration), None))
        record_offline(replace(plan, changes=changes), path)
        return
    from .graph_runs import for_graph, pause, reset, retune, run

    actions = [retune(_ns(share * duration), *what) for share, *what in _RETUNED]
    actions += [reset(_ns(share * duration), node) for share, node in _RESET]
    actions += [pause(_ns(0.35 * duration), True), pause(_ns(0.35 * duration), False)]
    lockstep = name == LOCKSTEP
    assert run(for_graph(plan, lockstep, speed=1.0 if lockstep else 0.0), path, actions)


def _ns(time_s: float) -> int:
    return round(time_s * 1e9)
