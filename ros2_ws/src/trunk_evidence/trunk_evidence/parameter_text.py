"""Parameters' values as text, the same at a terminal and in a report; changed rule tables cell by cell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, NamedTuple

from trunk_control.rule_tables import Axes, CellChange, axes_of, cell_changes, is_table
from trunk_core.parameters.declarations import Value
from trunk_core.units import seconds

if TYPE_CHECKING:
    from .recorded_run import RecordedRun


_WIDEST = 40  # characters of an array whose values are all listed
_CELLS = 8  # changed cells that are named
_NAMES = 8  # changed parameters that are named
_GRID = 14  # rows and columns of a grid; of a larger table those with changes, as many


def value_text(value: object) -> str:
    """Return a value as text, a dash for None; a table by its size."""
    if is_table(value) and isinstance(value, tuple | list):
        return f"{len(value)} × {len(value[0].split())} cells"
    if isinstance(value, tuple | list):
        texts = [value_text(item) for item in value]
        if len(", ".join(texts)) <= _WIDEST or len(texts) < 4:
            return f"[{', '.join(texts)}]"
        return f"[{', '.join(texts[:2])}, …, {texts[-1]}] ({len(texts)} in all)"
    if isinstance(value, float):
        return f"{value:.6g}"
    return "–" if value is None else str(value)


def full_text(value: object) -> str:
    """Return a value as text in full precision, a table with all its rows."""
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(full_text, value)) + "]"
    return "–" if value is None else str(value)


def differing_texts(values: Sequence[object], axes: Axes | None = None) -> tuple[str, ...]:
    """Return texts of a parameter's values in several runs: what differs looks different.

    ``axes``: of a rule table; the first run's is named by its size, the others by the cells that differ.
    """
    first = values[0]
    if axes is not None and is_table(first):
        return (value_text(first), *(_against(first, value, axes) for value in values[1:]))
    texts = tuple(map(value_text, values))
    if len(set(texts)) == len(set(map(repr, values))):
        return texts
    if (
        isinstance(first, tuple | list)
        and len({len(v) for v in values if isinstance(v, tuple | list)}) == 1
    ):
        return (value_text(first), *(_elements(first, value) for value in values[1:]))
    return tuple(map(full_text, values))


def cells_text(changes: Sequence[CellChange], axes: Axes) -> str:
    """Return changed cells as text: ``2 cells: (NS, ZO) S → B, (ZO, ZO) B → S``."""
    named = [
        f"({axes.error[c.row]}, {axes.rate[c.column]}) {c.before} → {c.after}" for c in changes
    ]
    more = [f"… and {len(named) - _CELLS} more"] if len(named) > _CELLS else []
    count = f"{len(named)} cell{'s' if len(named) > 1 else ''}"
    return f"{count}: {', '.join(named[:_CELLS] + more)}" if named else "no cell"


def change_text(before: object, after: object, axes: Axes) -> str:
    """Return the difference between two rule tables: cells, or another size."""
    try:
        return cells_text(cell_changes(before, after), axes)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return f"{value_text(after)}, not {value_text(before)}"


def transition_text(before: object, after: object, parameters: Mapping[str, object]) -> str:
    """Return the change of a parameter as text: ``60 → 90``, of a rule table its changed cells.

    ``parameters``: of its node, among them the labels of its tables.
    """
    if is_table(before) and is_table(after):
        return change_text(before, after, axes_of(before, parameters))  # type: ignore[arg-type]
    return " → ".join(differing_texts((before, after)))


def transitions_text(before: Mapping[str, object], after: Mapping[str, object]) -> str:
    """Return the changes of a node's parameters as text: ``gains.i 2 → 3; gains.p_max 60 → 90``.

    ``before``: all of them; ``after``: some, of which those that are the same are left out.
    """
    texts = [
        f"{name} {transition_text(before.get(name), value, before)}"
        for name, value in sorted(after.items())
        if value != before.get(name)
    ]
    more = [f"… and {len(texts) - _NAMES} more"] if len(texts) > _NAMES else []
    return "; ".join(texts[:_NAMES] + more)


def change_grid(before: Sequence[str], after: Sequence[str], axes: Axes) -> list[list[str]]:
    """Return the second table as rows of texts, labels first, changed cells as ``S→B``.

    Of a large table only rows and columns with changes are there, and not more than a screen takes; of tables
    of different shapes nothing.
    """
    try:
        changes = cell_changes(before, after)
    except ValueError:
        return []
    texts = [row.split() for row in after]
    for change in changes:
        texts[change.row][change.column] = f"{change.before}→{change.after}"
    rows = _places(len(axes.error), {change.row for change in changes})
    columns = _places(len(axes.rate), {change.column for change in changes})
    grid = [["e \\ e_dot", *(axes.rate[j] for j in columns)]]
    return grid + [[axes.error[i], *(texts[i][j] for j in columns)] for i in rows]


def _elements(first: Sequence[object], value: object) -> str:
    """Return the elements that differ from those of the first array, by their indices."""
    if not isinstance(value, tuple | list):
        return value_text(value)
    differ = [
        f"[{k}] {full_text(a)} → {full_text(b)}"
        for k, (a, b) in enumerate(zip(first, value, strict=True))
        if repr(a) != repr(b)
    ]
    more = [f"… and {len(differ) - 1} more"] if len(differ) > 1 else []
    return ", ".join([*differ[:1], *more]) or "the same"


def _places(count: int, changed: Iterable[int]) -> list[int]:
    return list(range(count)) if count <= _GRID else sorted(changed)[:_GRID]


def _against(first: object, value: object, axes: Axes) -> str:
    if value == first or not is_table(value):
        return "the same" if value == first else value_text(value)
    return change_text(first, value, axes)


_LINES = 20


class ChangedParameter(NamedTuple):
    """A parameter that was changed while a run went on. Given by `Run.changed`.

    ``t``: the new value counts from the first state after this time, s; 0 also where it counts from the
    first. ``before``: None if it is not on record. ``words``: ``60 → 90``, of a rule table its changed cells.
    """

    t: Annotated[float, "s; it counts from the first state after it"]
    node: str
    name: str
    before: Annotated[Value | None, "null: not on record"]
    after: Value
    words: str

    def describe(self) -> str:
        """Return the change as a line."""
        return f"t = {self.t:.9g} s: {self.node}: {self.name} {self.words}"


def changed_parameters(run: RecordedRun) -> list[ChangedParameter]:
    """Return the changes while a run went on, by time; at one time by node, in the order of the file."""
    changes = []
    changed = {run.relative(c.node): c for c in run.parameter_messages if c.changed}
    for node in (name for name in changed if name in run.parameters):
        process = run.process(node)
        known = dict(process.parameters) if process else {}
        for change in run.parameter_changes(node):
            t = max(seconds(change.stamp_ns), 0.0)
            for name, after in change.changed.items():
                before = known.get(name)
                words = transition_text(before, after, known)
                changes.append(ChangedParameter(t, node, name, before, after, words))
            known.update(change.changed)
    return sorted(changes, key=lambda change: change.t)


def lines_of(changes: Sequence[ChangedParameter]) -> list[str]:
    """Return a line for each of the first changes; a dragged slider makes hundreds."""
    lines = [change.describe() for change in changes[:_LINES]]
    more = len(changes) - _LINES
    return [*lines, f"and {more} more: trunk info RUN --json"] if more > 0 else lines
