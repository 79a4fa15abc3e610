"""The parameters that were changed while a run went on, as every verb shows them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from trunk_msgs_util.parameters.declarations import Value
from trunk_msgs_util.units import seconds

from .parameter_text import transition_text

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun

_LINES = 20


class ChangedParameter(NamedTuple):
    """A parameter that was changed while a run went on. Given by `Run.changed`.

    ``t``: the new value counts from the first state after this time, s; 0 also where it counts from the
    first. ``before``: None if it is not on record. ``words``: ``60 → 90``, of a rule table its changed cells.
    """

    t: float
    node: str
    name: str
    before: Value | None
    after: Value
    words: str

    def describe(self) -> str:
        """Return the change as a line."""
        return f"t = {self.t:.9g} s: {self.node}: {self.name} {self.words}"


def changed_parameters(run: RecordedRun) -> list[ChangedParameter]:
    """Return the changes while a run went on, by time; at one time in the order of the file."""
    values: dict[str, dict[str, Value]] = {}
    changes = []
    for change in run.recording.parameter_messages():
        node = run.recording.relative(change.node)
        known = values.setdefault(node, {})
        known.update(change.new)  # at the start of each process
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
