"""What a run's controller was asked to do. Runs of different tasks can be compared, but none is the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util.parameters.declarations import declarations
from trunk_sim.disturbance_config import DisturbanceConfig

from ..plans.nodes import CONTROLLERS

if TYPE_CHECKING:
    from trunk_msgs_util.parameters.declarations import Value

    from .run_view import RunView

# Plant, start, measurement, links, drive and length; not the time step, nor how the run was paced.
_OF_SIMULATOR = (
    "plant.",
    "path.",
    "hip.",
    "initial.",
    "sensor.",
    "actuator.",
    "link.",
    "fall.",
    "max_effort",
    "duration",
)
_OF_CONTROLLER = ("reference.",)
# Without any of these parameters a part of the disturbance does nothing, whatever its others are.
_ACTS = {
    "pulse.": ("pulse.start_times", "pulse.random_count"),
    "sine.": ("sine.amplitude",),
    "noise.": ("noise.rms",),
    "table.": ("table.times",),
}
# Parameters whose change during the run makes another task.
_LATER = {
    "simulator": _OF_SIMULATOR,
    "controller": _OF_CONTROLLER,
    "disturbance": tuple(_ACTS),
}
_LISTED = 4  # of the parameters that differ, in a line


def different_tasks(views: Sequence[RunView]) -> tuple[str, ...]:
    """Return the names (``role.name``) of what makes the runs' tasks different; none if they are the same.

    This follows from the record: without a simulator's parameters, from the scenario's name; without a
    controller's parameters, from the references that it received.
    """
    tasks = [_task(view) for view in views]
    if any(view.run.another_controller or view.run.external for view in views):
        first = views[0].table.reference
        for view, task in zip(views, tasks, strict=True):
            for name in [name for name in task if name.startswith("controller.")]:
                del task[name]
            task["reference"] = np.array_equal(view.table.reference, first)
    if not any(view.run.fall for view in views):
        for task in tasks:  # what a fall would have done is the same for runs without one
            task.pop("simulator.fall.stop", None)
    names = sorted({name for task in tasks for name in task})
    return tuple(name for name in names if any(t.get(name) != tasks[0].get(name) for t in tasks))


def not_ranked(names: Sequence[str]) -> str:
    """Return a line that says which parameters make the tasks different; empty if they are the same."""
    if not names:
        return ""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return f"NOT RANKED: the runs have different tasks: {', '.join(names[:_LISTED])}{more}"


def _task(view: RunView) -> dict[str, Value]:
    simulator = view.parameters.get("simulator")
    if simulator is None:
        return {"scenario": view.recording.provenance.get("scenario", "")}
    disturbance = {d.name: d.default for d in declarations(DisturbanceConfig).values()}
    disturbance |= view.parameters.get("disturbance", {})
    acting = tuple(
        part for part, names in _ACTS.items() if any(disturbance[name] for name in names)
    )
    task = _chosen("simulator", simulator, _OF_SIMULATOR)
    task |= _chosen("disturbance", disturbance, acting)
    for node, values in view.parameters.items():
        if node in CONTROLLERS:
            task |= _chosen("controller", values, _OF_CONTROLLER)
    later: dict[str, list[object]] = {}
    for node in view.parameters:
        role = "controller" if node in CONTROLLERS else node
        for change in view.run.parameter_changes(node):
            for name, value in _chosen(role, change.changed, _LATER.get(role, ())).items():
                later.setdefault(name, [task.get(name)]).append((change.stamp_ns, value))
    return {**task, **{name: str(values) for name, values in later.items()}}


def _chosen(role: str, values: Mapping[str, Value], begins: tuple[str, ...]) -> dict[str, Value]:
    return {f"{role}.{name}": value for name, value in values.items() if name.startswith(begins)}
