"""A report: its text and tables, and the page, one HTML file without network, server or second file.

A recording's content enters the page in only two ways: as text, escaped by Jinja's autoescaping, and as
JSON in a script block that is not run, with every ``<`` escaped. The content security policy allows the
page's own script, by its digest, and no connections.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import degrees
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup
from matplotlib.figure import Figure

from trunk_control.rule_base import RuleBaseConfig
from trunk_core.files import resolve_path
from trunk_core.results import number
from trunk_core.text import shell_words
from trunk_core.topics import Event
from trunk_core.units import seconds
from trunk_evidence.doctor import INFO, findings
from trunk_evidence.doubts import Doubts, doubts_of
from trunk_evidence.parameter_text import (
    changed_parameters,
    differing_texts,
    full_text,
    lines_of,
    value_text,
)
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_metrics import QUANTITIES
from trunk_recording.reader import RecordingError
from trunk_recording.schemas import RunEvent
from trunk_runs.nodes import CONTROLLERS, why_not_with
from trunk_sim.plant import TRUNK

from .comparison import (
    Row,
    different_tasks,
    differing_parameters,
    metric_rows,
    not_ranked,
    split_parameters,
    table_axes,
    table_grids,
)
from .parts.page import REPORT_SCRIPTS, REPORT_STYLES, inline, part, policy, rendered, write_page
from .plots import drawn, planes, with_unit
from .report_data import report_data
from .rule_plots import surface
from .run_view import RunView, labels, on_tracks, rule_use, words_of

_MOST_EVENTS = 1_000  # that are listed: a hostile file may hold any number
_SURFACE_DPI = 60  # of what is not lines: a surface is smooth
_NOT_OURS = (
    "not judged: the states are another robot's; the angle is shown as measured, the torque as commanded, "
    "and hip and true angle are not known"
)


@dataclass(frozen=True)
class RuleCell:
    """A rule of the tables: the labels of its consequents, and how often it fired."""

    labels: tuple[str, ...]
    count: int
    share: float  # of the updates


@dataclass(frozen=True)
class RuleUse:
    """The rules of a run."""

    outputs: tuple[tuple[str, str], ...]  # name and symbol of each
    columns: tuple[str, ...]  # labels of e_dot
    rows: tuple[tuple[str, tuple[RuleCell, ...]], ...]  # a label of e, and its cells


@dataclass(frozen=True)
class RunSection:
    """What the report says about one run."""

    label: str
    title: str
    words: Callable[[str], str]  # as of the report, of this run's plant
    scenario: str
    facts: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, str]]  # by node
    provenance: Mapping[str, str]
    topics: tuple[tuple[str, str, int], ...]  # name, type, messages
    rules: RuleUse | None  # None: the law has no rules
    events: tuple[tuple[float, str], ...]  # time in s, words
    later_events: int  # that are not listed
    branch: str  # its file, quoted for a shell; empty where it cannot be branched
    controllers: tuple[str, ...]  # that a branch may have
    hip: bool  # False: another robot, of whose hip nothing is known


@dataclass(frozen=True)
class PlanePicture:
    """Planes as an SVG file, over which the page moves a dot for each run."""

    title: str
    text: str
    source: str  # a data URL
    axes: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Report:
    """The whole report."""

    title: str
    kicker: str  # what the runs are of
    words: Callable[[str], str]  # puts texts of ours into those of their plant
    runs: tuple[RunSection, ...]
    metrics: tuple[Row, ...]
    no_metrics: str  # why there are none
    not_ranked: str  # why no run is the best; empty: one may be
    differing: Mapping[str, tuple[str, ...]]
    only: Mapping[str, Mapping[str, str]]  # parameters that only some runs have, by their names
    tables: tuple[
        tuple[str, list[list[str]]], ...
    ]  # rule tables that differ: a title, rows of texts
    pictures: tuple[PlanePicture, ...]
    data: dict[str, Any]


def make_report(views: Sequence[RunView]) -> Report:
    """Return the report on one run or several."""
    names = labels(views)
    doubts = [doubts_of(view.run) for view in views]
    tasks = different_tasks(views)
    try:
        rows, reason = metric_rows(views, doubts, tasks), ""
    except RecordingError as error:
        rows, reason = (), str(error)
    differing = differing_parameters(views) if len(views) > 1 else {}
    axes = table_axes(views, differing)
    beside, only = split_parameters(names, differing)
    return Report(
        title=" · ".join(names),
        kicker=_kicker(views),
        words=words_of(views),
        runs=tuple(map(_section, views, names, doubts)),
        metrics=rows,
        no_metrics=reason,
        not_ranked=not_ranked(tasks),
        differing={n: differing_texts(values, axes.get(n)) for n, values in beside.items()},
        only={w: {n: value_text(v) for n, v in values.items()} for w, values in only.items()},
        tables=tuple(table_grids(names, differing, axes)),
        pictures=tuple(_pictures(views, names)),
        data=report_data(views),
    )


def render(report: Report) -> str:
    """Return the page."""
    script = inline("\n".join(map(part, REPORT_SCRIPTS)))
    return rendered(
        "trunk_views.parts",
        "report.html.j2",
        report=report,
        words=report.words,
        data=htmlsafe_json_dumps(report.data, allow_nan=False, separators=(",", ":")),
        policy=policy(script),
        style=Markup("".join(map(part, REPORT_STYLES))),
        script=Markup(script),
        metric_text=metric_text,
        quantity_label=lambda key: report.words(quantity_label(key)),
        breakable=lambda name: Markup("<wbr>").join(re.split(r"(?<=[._])", name)),
    )


def _kicker(views: Sequence[RunView]) -> str:
    plants = dict.fromkeys(view.plant for view in views if view.pictured and view.plant)
    if plants:
        trunk = "Biped trunk on a sinusoidal hip path"
        return " · ".join(trunk if p.name == TRUNK else p.label for p in plants)
    unknown = [view.unknown_plant for view in views if view.unknown_plant]
    return f"Plant {unknown[0]}, which cannot be used here" if unknown else "Another robot's joint"


def write(report: Report, path: Path) -> int:
    """Write the page; return its size in bytes. Raises OSError."""
    return write_page(render(report), path)


def metric_text(value: float | None) -> str:
    """Return a run's metric as text."""
    return number(value, 5).replace("-", "−")


def quantity_label(key: str) -> str:
    """Return a metric's readable name with its unit."""
    quantity = QUANTITIES.get(key)
    return with_unit(quantity.label, quantity.unit) if quantity else key


def said_of(view: RunView) -> list[str]:
    """Return the faults of a run: what `findings` finds, another robot, unusable parameters."""
    faults = [finding.describe() for finding in findings(view.run) if finding.severity != INFO]
    faults += [_NOT_OURS] if view.run.another_robot else []
    return faults + [w for w in view.warnings if w not in view.recording.warnings]


def _section(view: RunView, label: str, doubts: Doubts) -> RunSection:
    table, recording, events = view.table, view.recording, _events(view.run)
    state = "complete" if recording.complete else "incomplete"
    fall, plant = view.run.fall, view.plant.name if view.plant else TRUNK
    facts = (
        ("controller", view.title),
        ("scenario", recording.provenance.get("scenario", "not recorded") or "none"),
        ("mode", recording.provenance.get("mode", "not recorded")),
        ("states", f"{len(table.t)} from {table.t[0]:g} s to {table.t[-1]:g} s"),
        ("file", f"{resolve_path(view.path).name}, {state}"),
        *((("branch", view.run.branch.describe()),) if view.run.branch else ()),
        *(("changed", line) for line in lines_of(changed_parameters(view.run))),
        *((("fell", f"at t = {seconds(fall.stamp_ns):g} s"),) if fall else ()),
    )
    return RunSection(
        label=label,
        title=view.title,
        words=words_of([view]),
        scenario=recording.provenance.get("scenario", ""),
        facts=facts,
        warnings=tuple(dict.fromkeys([*doubts.lines, *said_of(view)])),
        parameters={
            node: {name: full_text(value) for name, value in values.items()}
            for node, values in view.parameters.items()
        },
        provenance=dict(sorted(recording.provenance.items())),
        topics=tuple((n, topic.type, topic.count) for n, topic in sorted(recording.topics.items())),
        rules=_rules(view),
        events=tuple(events[:_MOST_EVENTS]),
        later_events=len(events[_MOST_EVENTS:]),
        branch="" if view.run.another_robot else shell_words(str(view.path)),
        controllers=tuple(name for name in CONTROLLERS if not why_not_with(plant, name)),
        hip=view.pictured,
    )


def _events(run: RecordedRun) -> list[tuple[float, str]]:
    """Return a run's events by time: the nodes' own, and the parameters that were changed."""
    happened = [
        (
            max(seconds(event.stamp_ns), 0.0),
            f"{run.relative(event.node)}: {_words(event)}",
        )
        for event in run.events
        if event.message != Event.RETUNED
    ]
    happened += [
        (change.t, f"{change.node}: {change.name} {change.words}")
        for change in changed_parameters(run)
    ]
    return sorted(happened, key=itemgetter(0))


def _words(event: RunEvent) -> str:
    values = {name: value for name, value in event.values.items() if name != "process"}
    if event.message == Event.FELL:
        with suppress(ValueError):  # words of an external node
            values = {name: f"{degrees(float(value)):.4g}°" for name, value in values.items()}
    more = ", ".join(f"{name} {value}" for name, value in values.items())
    return f"{event.message} ({more})" if more else event.message


def _pictures(views: Sequence[RunView], names: Sequence[str]) -> Iterator[PlanePicture]:
    everyone = list(range(len(views)))
    hips = [i for i in everyone if views[i].pictured]
    yield _picture(
        planes(views),
        words_of(views)("Hip path and phase portrait"),
        "Dots: where each run is at the time shown.",
        [
            (["x", "height" if on_tracks(views) else "x_dot"], hips, False),
            (["theta", "theta_dot"], everyone, False),
        ],
    )
    for i, view in enumerate(views):
        if isinstance(view.controller, RuleBaseConfig) and view.terms is not None:
            columns = ["rules_e", "rules_rate"]
            yield _picture(
                surface(view),
                f"Fuzzy surfaces of {names[i]}",
                "What the rules infer at each error e and rate ė, and the run's path; "
                "inputs beyond the edge act like the edge.",
                [(columns, [i], True) for _ in view.controller.tables],
            )


def _picture(
    figure: Figure, title: str, text: str, of: Sequence[tuple[list[str], list[int], bool]]
) -> PlanePicture:
    """Return a figure for the page.

    ``of``: for each of its axes, the columns over them, the runs, and whether these stay within its edges.
    """
    data = drawn(figure, ".svg", _SURFACE_DPI)  # which gives the axes their places
    axes = []
    places = [place for place in figure.axes if place.get_label() != "<colorbar>"]
    for place, (columns, runs, edge) in zip(places, of, strict=True):
        box = place.get_position()
        scale = np.asarray if columns[1] == "height" else np.radians
        axes.append(
            {
                "box": [box.x0, 1.0 - box.y1, box.width, box.height],
                "x": scale(place.get_xlim()).tolist(),
                "y": list(place.get_ylim()),
                "of": columns,
                "runs": runs,
                "edge": edge,
            }
        )
    source = f"data:image/svg+xml;base64,{base64.b64encode(data).decode('ascii')}"
    return PlanePicture(title, text, source, tuple(axes))


def _rules(view: RunView) -> RuleUse | None:
    config = view.controller
    if not isinstance(config, RuleBaseConfig):
        return None
    counts = rule_use(view)
    updates = max(1, len(view.terms or ()))
    tables = [table.cells for table in config.tables]
    rows = tuple(
        (
            label,
            tuple(
                RuleCell(tuple(cells[i][j] for cells in tables), count, count / updates)
                for j, count in enumerate(counts[i])
            ),
        )
        for i, label in enumerate(config.axes.error)
    )
    outputs = tuple((table.name, table.title) for table in config.tables)
    return RuleUse(outputs, config.axes.rate, rows)
