"""Runs side by side: what they were asked to do, metrics, parameters that differ, where each diverges.

Runs of different tasks can be compared, but none is the best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from trunk_control.rule_tables import Axes, axes_of, is_table
from trunk_core.parameters.declarations import Value, declarations
from trunk_evidence.differences import RunDiff, diff
from trunk_evidence.doubts import Doubts, doubts_of
from trunk_evidence.parameter_text import ChangedParameter, change_grid, changed_parameters
from trunk_evidence.recorded_run import BranchOf, RecordedRun
from trunk_evidence.run_metrics import QUANTITIES
from trunk_evidence.run_table import metrics
from trunk_recording.reader import RecordingError
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.disturbance_config import DisturbanceConfig

from .run_view import RunView, labels, words_of

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


class Row(NamedTuple):
    """A metric of every run; ``best``: the indices of the runs with the lowest value."""

    key: str
    values: tuple[float | None, ...]
    best: tuple[int, ...]


@dataclass(frozen=True)
class Comparison:
    """What `compare` found. Parameters: by ``role.name``, one value per run, None if it has none."""

    names: tuple[str, ...]
    doubts: tuple[Doubts, ...]
    tasks: tuple[str, ...]  # what makes the runs' tasks different, so that none is the best
    rows: tuple[Row, ...]
    parameters: Mapping[str, tuple[Value | None, ...]]
    axes: Mapping[str, Axes]  # of those that are rule tables
    changed: tuple[Sequence[ChangedParameter], ...]  # of each run, while it went on
    branches: tuple[BranchOf | None, ...]
    diffs: tuple[RunDiff, ...]  # of the second run and the following against the first
    words: Callable[[str], str]  # of the runs' plant, for texts of ours


def best_of(values: Sequence[float | None], sound: Sequence[bool] | None = None) -> tuple[int, ...]:
    """Return the indices of the smallest magnitude: all that tie, none if there is nothing to choose.

    Only the ``sound`` runs take part: a run that fell, is incomplete or did not keep time is never the best.
    """
    allowed = [True] * len(values) if sound is None else sound
    magnitudes = [abs(v) for v, good in zip(values, allowed, strict=True) if good and v is not None]
    least = min(magnitudes, default=inf)
    if least == inf or len(values) < 2:
        return ()
    return tuple(
        i for i, v in enumerate(values) if allowed[i] and v is not None and abs(v) == least
    )


def metrics_of(view: RunView) -> dict[str, float | None]:
    """Return a run's metrics. Raises RecordingError, naming the file, if its data allow none."""
    if view.run.another_robot:
        raise RecordingError(
            f"{view.path}: a robot that is not ours: metrics are of the true angle, which is not known"
        )
    try:
        return metrics(view.table).as_dict()
    except ValueError as error:
        raise RecordingError(f"{view.path}: {error}; record a complete run") from None


def metric_rows(
    views: Sequence[RunView], doubts: Sequence[Doubts], tasks: Sequence[str]
) -> tuple[Row, ...]:
    """Return the rows of the table of metrics; no doubtful run is best, and none if ``tasks`` differ."""
    sound = [not doubt and not tasks for doubt in doubts]
    metrics = [metrics_of(view) for view in views]
    rows = []
    for key in metrics[0]:
        values = tuple(run[key] for run in metrics)
        ranked = key in QUANTITIES and QUANTITIES[key].ranked
        rows.append(Row(key, values, best_of(values, sound) if ranked else ()))
    return tuple(rows)


def differing_parameters(views: Sequence[RunView]) -> dict[str, tuple[Value | None, ...]]:
    """Return the parameters that are not the same in all runs.

    Controllers are matched by place, whatever their node is called; the recorder's parameters are left out.
    """
    runs = []
    strange = any(view.run.external for view in views)  # of which no parameter is known
    for view in views:
        values: dict[str, Value] = {}
        for node, parameters in view.parameters.items():
            role = "controller" if node in CONTROLLERS else node
            known = not (strange and role in ("controller", "reference"))
            if role != "recorder" and known:
                values |= {f"{role}.{name}": value for name, value in parameters.items()}
        if strange:
            values.pop("simulator.wait_for", None)
        if view.run.acting:
            values["controller"] = ", ".join(view.run.acting)
        runs.append(values)
    names = sorted({name for values in runs for name in values})
    table = {name: tuple(values.get(name) for values in runs) for name in names}
    return {name: row for name, row in table.items() if any(value != row[0] for value in row)}


def split_parameters(
    names: Sequence[str], parameters: Mapping[str, tuple[Value | None, ...]]
) -> tuple[dict[str, tuple[Value | None, ...]], dict[str, dict[str, Value]]]:
    """Return the differing parameters to be shown side by side, and those that only some runs have.

    The latter by the names of these runs, among which they do not differ.
    """
    beside: dict[str, tuple[Value | None, ...]] = {}
    only: dict[tuple[int, ...], dict[str, Value]] = {}
    for name, values in parameters.items():
        there = [value for value in values if value is not None]
        if len(there) == len(values) or any(value != there[0] for value in there):
            beside[name] = values
        else:
            whose = tuple(i for i, value in enumerate(values) if value is not None)
            only.setdefault(whose, {})[name] = there[0]
    return beside, {", ".join(names[i] for i in whose): only[whose] for whose in sorted(only)}


def table_axes(
    views: Sequence[RunView], parameters: Mapping[str, tuple[Value | None, ...]]
) -> dict[str, Axes]:
    """Return the labels of the rule tables among differing parameters, as the first run has them."""
    nodes = [values for view in views for values in view.parameters.values()]
    return {
        name: axes_of(rows, next((n for n in nodes if n.get(name.partition(".")[2]) == rows), {}))  # type: ignore[arg-type]
        for name, (rows, *_) in parameters.items()
        if is_table(rows)
    }


def table_grids(
    names: Sequence[str],
    parameters: Mapping[str, tuple[Value | None, ...]],
    axes: Mapping[str, Axes],
) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield a title and rows of texts for each rule table of a run that differs from the first run's."""
    for name, labels_of_table in axes.items():
        first, *others = parameters[name]
        for run, rows in zip(names[1:], others, strict=True):
            if rows != first and is_table(rows):
                grid = change_grid(first, rows, labels_of_table)  # type: ignore[arg-type]
                if grid:
                    yield f"{name}: from {names[0]} to {run}", grid


def divergence(first: RecordedRun, other: RecordedRun) -> RunDiff:
    """Return the first divergence of a run from another; with different laws ``~/state`` is not compared."""
    return diff(first, other, terms=first.controllers == other.controllers)


def compare(views: Sequence[RunView]) -> Comparison:
    """Compare runs; the divergence of the others is relative to the first."""
    doubts = [doubts_of(view.run) for view in views]
    tasks = different_tasks(views)
    parameters = differing_parameters(views)
    return Comparison(
        names=tuple(labels(views)),
        doubts=tuple(doubts),
        tasks=tasks,
        rows=metric_rows(views, doubts, tasks),
        parameters=parameters,
        axes=table_axes(views, parameters),
        changed=tuple(changed_parameters(view.run) for view in views),
        branches=tuple(view.run.branch for view in views),
        diffs=tuple(divergence(views[0].run, view.run) for view in views[1:]),
        words=words_of(views),
    )
