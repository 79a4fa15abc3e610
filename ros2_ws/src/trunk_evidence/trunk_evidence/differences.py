"""Two recordings compared topic by topic, by stamp, bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Annotated, NamedTuple

import numpy as np

from trunk_control.laws import law_named
from trunk_control.pid_family import UNITS
from trunk_control.rule_tables import axes_of, is_table
from trunk_core import topics
from trunk_core.arrays import Integers
from trunk_core.parameters.declarations import ParameterError
from trunk_core.units import seconds
from trunk_recording.joint_table import QUANTITIES, JointTable
from trunk_recording.reader import RecordingError
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.plant import Plant
from trunk_sim.plants.trunk import PLANT

from .parameter_text import change_grid, change_text, changed_parameters, differing_texts
from .recorded_run import RecordedRun
from .verdict import ComparedColumn, apart, differences_in, unequal

# In the order in which a difference spreads through one step of the loop.
_TOPICS = (topics.GROUND_TRUTH, topics.DISTURBANCE, topics.JOINT_STATES, topics.EFFORT_COMMAND)
# Parameters on which no state and no command of an exact run depends.
_OF_PACE = (
    "autostart",
    "lockstep.",
    "wait_for",
    "publish_clock",
    "command_timeout",
    "duration",
    "controllers",
)
_OF_READING = {"reference": "rad", "measurement": "rad"}  # in each record of terms


class FirstDifference(NamedTuple):
    """Where two runs diverge: at this stamp, in this field."""

    stamp_ns: int
    topic: str
    field: Annotated[str, "Both null: it says what either has"]
    a: Annotated[float | None, "null: missing in the first"]
    b: Annotated[float | None, "null: missing in the second"]

    def describe(self, same_plan: bool = True, hip: str = "hip", plant: Plant = PLANT) -> str:
        """Return the difference as one line: where, both values, how far apart.

        It gives ULPs for runs that should be equal, those of the ``same_plan``, and units for others.
        ``hip``: the name of the hip's joint, or of another plant's first.
        """
        head = f"t = {seconds(self.stamp_ns):g} s: {self.topic}: {self.field}"
        if self.a is None and self.b is None:
            return head
        if self.a is None or self.b is None:
            return f"{head}: only in {'B' if self.a is None else 'A'}"
        if not same_plan:
            unit = _unit(self.topic, self.field, hip, plant)
            a, b, gap = (f"{x:.6g}{unit}" for x in (self.a, self.b, abs(self.b - self.a)))
            return f"{head}: {a} in A, {b} in B, {gap} apart"
        return f"{head}: {self.a!r} in A, {self.b!r} in B{apart(self.a, self.b)}"


@dataclass
class RunDiff:
    """All that differs between two runs. Data decide; the rest helps explain.

    ``record``: events, log times, and what is not as its recorder wrote it. ``same_plan``: both should have
    the same bits, because time was exact and no parameter on which a state or a command depends differs.
    """

    compared: int = 0  # messages
    differing_steps: int = 0
    first: FirstDifference | None = None
    same_plan: bool = True
    hip: str = "hip"  # the name of the hip's joint
    plant: Plant = PLANT  # of the first
    parameters: list[str] = field(default_factory=list)
    tables: dict[str, list[list[str]]] = field(
        default_factory=dict
    )  # rule tables, what changes marked
    provenance: list[str] = field(default_factory=list)
    record: list[str] = field(default_factory=list)

    @property
    def identical(self) -> bool:
        """True where every message of every compared topic has the same bits."""
        return self.first is None

    def describe(self) -> str:
        """Return in one line whether and where the runs differ."""
        if self.first is None:
            return "identical, bit for bit"
        return self.first.describe(self.same_plan, self.hip, self.plant)


def diff(a: RecordedRun, b: RecordedRun, terms: bool = True) -> RunDiff:
    """Compare two runs. Namespaces are ignored; ``terms``: compare the controllers' ``~/state`` too."""
    result = RunDiff()
    steps: set[int] = set()
    firsts = []
    for relative in (*_TOPICS, *(_state_topics(a, b) if terms else ())):
        here, there = a.joints(relative), b.joints(relative)
        result.compared += max(len(here), len(there))
        stamps, first = compare_topic(relative, here, there)
        steps.update(stamps)
        firsts += [first] if first else []
    result.differing_steps = len(steps)
    result.first = min(
        firsts, key=lambda f: f.stamp_ns, default=None
    )  # min keeps the topics' order
    result.same_plan = _same_plan(a, b)
    joints = a.parameters.get("simulator", {}).get("joints")
    if isinstance(joints, tuple) and joints:
        result.hip = str(joints[0])
    with suppress(ParameterError, RecordingError):
        result.plant = a.plant or PLANT
    result.parameters = [*_parameters(a, b), *_changed(a, b)]
    result.tables = _tables(a, b)
    result.provenance = _mappings("", a.recording.provenance, b.recording.provenance)
    result.record = [
        *_altered("A", a),
        *_altered("B", b),
        *(_log_times(a, b) if a.exact and b.exact else ()),
        *(_events(a, b) if a.mode == b.mode and a.exact else ()),
    ]
    return result


def _same_plan(a: RecordedRun, b: RecordedRun) -> bool:
    """Return True if two runs should be equal; parameters of their length and pace alone may differ."""
    if not (a.exact and b.exact) or set(a.controllers) != set(b.controllers):
        return False
    here, there = (
        {
            (node, name): value
            for node, values in run.parameters.items()
            for name, value in values.items()
            if node != "recorder" and not name.startswith(_OF_PACE)
        }
        for run in (a, b)
    )
    return here == there and all(
        [change.changed for change in a.parameter_changes(node)]
        == [change.changed for change in b.parameter_changes(node)]
        for node in a.parameters
    )


def _unit(topic: str, field: str, hip: str, plant: Plant) -> str:
    """Return the unit of a value, with the space before it: ``position[trunk]`` of a state is in rad."""
    quantity, _, name = field.removesuffix("]").partition("[")
    if topics.is_controller_state(topic):
        law = topic.partition("/")[0]
        own = (
            law_named(law).units if law in CONTROLLERS else {}
        )  # which may be installed nowhere here
        unit = plant.of_drive({**UNITS, **_OF_READING, **own}.get(name, ""))
    else:
        coordinate = plant.coordinates[name != hip]
        if quantity == "effort":  # the drive's stands beside the joint that is held
            drives = name != hip and topic != topics.DISTURBANCE
            unit = (plant.driven if drives else coordinate).effort_unit
        else:
            unit = coordinate.unit + "/s" * (quantity == "velocity")
    return f" {unit}" if unit else ""


def _altered(letter: str, run: RecordedRun) -> list[str]:
    return [
        f"{part}: not as the recorder of {letter} wrote it (digest)"
        for part in run.recording.alterations()
    ]


def _log_times(a: RecordedRun, b: RecordedRun) -> list[str]:
    """Compare when messages were logged, where that is simulated time: one line for each topic."""
    lines = []
    for relative in _TOPICS:
        here, there = (run.joints(relative).log_time_ns for run in (a, b))
        shorter = min(len(here), len(there))
        rows = np.flatnonzero(here[:shorter] != there[:shorter])
        if len(rows):
            times = (seconds(int(log[rows[0]])) for log in (here, there))
            lines.append("{}: logged at {:g} s in A, {:g} s in B".format(relative, *times))
    return lines


def _events(a: RecordedRun, b: RecordedRun) -> list[str]:
    """Compare each node's events in their order: a line for the first that differs."""
    lines = []
    here, there = _events_by_node(a), _events_by_node(b)
    for node in sorted(here.keys() | there.keys()):
        pairs = zip_longest(here.get(node, []), there.get(node, []), fillvalue="nothing")
        first = next(((x, y) for x, y in pairs if x != y), None)
        if first:
            lines.append(f"events of {node}: {first[0]} in A, {first[1]} in B")
    return lines


def _events_by_node(run: RecordedRun) -> dict[str, list[str]]:
    events: dict[str, list[str]] = {}
    for event in run.events:
        fields = {key: value for key, value in event.values.items() if key != "process"}
        values = "".join(f", {key} {value}" for key, value in fields.items())
        text = f"{event.message} at t = {seconds(event.stamp_ns):g} s{values}"
        events.setdefault(run.relative(event.node), []).append(text)
    return events


def _state_topics(a: RecordedRun, b: RecordedRun) -> list[str]:
    names = dict.fromkeys([*a.controllers, *b.controllers])
    return [topics.controller_state(name) for name in names]


def compare_topic(
    relative: str, a: JointTable, b: JointTable
) -> tuple[set[int], FirstDifference | None]:
    """Return the stamps at which a topic differs, and the first difference."""
    steps: set[int] = set()
    firsts = []
    keys_a, keys_b = _keys(a.stamp_ns, b.stamp_ns)
    for run, keys, others, values in (
        (a, keys_a, keys_b, (1.0, None)),
        (b, keys_b, keys_a, (None, 1.0)),
    ):
        lone = run.stamp_ns[~np.isin(keys, others)]
        if len(lone):
            steps.update(lone.tolist())
            firsts.append(FirstDifference(int(lone.min()), relative, "message", *values))
    _, rows_a, rows_b = np.intersect1d(keys_a, keys_b, return_indices=True)
    stamps = a.stamp_ns[rows_a]
    if not len(stamps):
        return steps, min(firsts, key=lambda f: f.stamp_ns, default=None)
    if a.names != b.names:
        names = " in A, ".join(", ".join(run.names) or "nothing" for run in (a, b))
        firsts.append(FirstDifference(int(stamps[0]), relative, f"name: {names} in B", None, None))
        steps.update(stamps.tolist())
        return steps, min(firsts, key=lambda f: f.stamp_ns)
    columns: list[ComparedColumn] = []
    for quantity in QUANTITIES:
        x, y = a.values(quantity)[rows_a], b.values(quantity)[rows_b]
        both, widest = sorted((x.shape[1], y.shape[1]))
        for name in a.names[both:widest][:1]:
            has = (1.0, None) if x.shape[1] > both else (None, 1.0)
            firsts.append(FirstDifference(int(stamps[0]), relative, f"{quantity}[{name}]", *has))
            steps.update(stamps.tolist())
        for i, name in enumerate(a.names[:both]):
            columns.append(ComparedColumn(relative, f"{quantity}[{name}]", x[:, i], y[:, i]))
    rows = np.flatnonzero(unequal(columns, len(stamps)))
    if len(rows):
        steps.update(stamps[rows].tolist())
        firsts.append(FirstDifference(*differences_in(int(rows[0]), stamps, columns)[0]))
    return steps, min(firsts, key=lambda f: f.stamp_ns, default=None)


def _keys(a: Integers, b: Integers) -> tuple[Integers, Integers]:
    """Return a number for each message, the same for the n-th with the same stamp in both runs."""
    stamps, (nth_a, nth_b) = np.union1d(a, b), (_nth(a), _nth(b))
    depth = max(nth_a.max(initial=0), nth_b.max(initial=0)) + 1
    return (
        np.searchsorted(stamps, a) * depth + nth_a,
        np.searchsorted(stamps, b) * depth + nth_b,
    )


def _nth(stamps: Integers) -> Integers:
    """Return, for each message, how many earlier ones have the same stamp."""
    order = np.argsort(stamps, kind="stable")
    rising = stamps[order]
    counts = np.empty(len(stamps), np.int64)
    counts[order] = np.arange(len(stamps)) - np.searchsorted(rising, rising)
    return counts


def _parameters(a: RecordedRun, b: RecordedRun) -> list[str]:
    here, there = a.parameters, b.parameters
    lines = []
    for node in sorted(here.keys() | there.keys()):
        if node not in here or node not in there:
            lines.append(f"{node}: only in {'A' if node in here else 'B'}")
        else:
            lines += _mappings(f"{node}: ", here[node], there[node])
    return lines


def _changed(a: RecordedRun, b: RecordedRun) -> list[str]:
    """Return the changes while one of the runs went on that the other has not, or at another time."""
    here, there = ([change.describe() for change in changed_parameters(run)] for run in (a, b))
    return [
        f"{line}, in {letter} alone"
        for letter, lines, others in (("A", here, there), ("B", there, here))
        for line in lines
        if line not in others
    ]


def _tables(a: RecordedRun, b: RecordedRun) -> dict[str, list[list[str]]]:
    """Return the rule tables that differ as grids, by their names."""
    grids = {}
    for node in sorted(a.parameters.keys() & b.parameters.keys()):
        here, there = a.parameters[node], b.parameters[node]
        for name, rows in here.items():
            changed = there.get(name)
            if rows != changed and is_table(rows) and is_table(changed):
                grid = change_grid(rows, changed, axes_of(rows, here))  # type: ignore[arg-type]
                grids[f"{node}.{name}"] = grid
    return {name: grid for name, grid in grids.items() if grid}


def _mappings(prefix: str, a: Mapping[str, object], b: Mapping[str, object]) -> list[str]:
    absent = "(none)"
    lines = []
    for key in sorted(a.keys() | b.keys()):
        here, there = a.get(key, absent), b.get(key, absent)
        if here == there:
            continue
        if is_table(here) and is_table(there) and isinstance(here, tuple):
            lines.append(
                f"{prefix}{key}, from A to B: {change_text(here, there, axes_of(here, a))}"
            )
        else:
            first, second = differing_texts((here, there))
            lines.append(f"{prefix}{key}: {first} in A, {second} in B")
    return lines
