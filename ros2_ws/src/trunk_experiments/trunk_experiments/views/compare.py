"""Runs side by side: metrics, parameters that differ, where each diverges from the first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from trunk_control.rule_tables import Axes, axes_of, is_table
from trunk_msgs_util.recording.reader import RecordingError

from ..analysis.metrics import QUANTITIES, metrics
from ..analysis.parameter_text import ChangedParameter, change_grid, changed_parameters
from ..plans.nodes import CONTROLLERS
from ..recorded.run import BranchOf, RecordedRun
from ..replay.diff import RunDiff, diff
from ..replay.doubts import Doubts, doubts_of
from .run_view import RunView, labels
from .task import different_tasks

if TYPE_CHECKING:
    from trunk_msgs_util.parameters.declarations import Value


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
    )
