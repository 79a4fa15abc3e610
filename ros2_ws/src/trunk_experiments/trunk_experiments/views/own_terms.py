"""What a law reports besides gains: its own terms, by their names and units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trunk_control.laws import law_named
from trunk_msgs_util import topics

from ..analysis.run_table import held_at
from ..plans.nodes import CONTROLLERS
from .run_view import RunView, own_terms_of, tells_gains

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_table import Floats

_UNITS = {"unsaturated": "N m"}


class OwnTerm(NamedTuple):
    """A term of a law's own."""

    name: str
    unit: str

    @property
    def title(self) -> str:
        """The name and the unit, for an axis."""
        name = self.name.replace("_", " ")
        return f"{name}, {self.unit}" if self.unit else name


def own_terms(views: Sequence[RunView]) -> list[OwnTerm]:
    """Return the terms of laws that report no gains, in their order, each once."""
    own: dict[str, OwnTerm] = {}
    for view in views:
        for controller in view.controllers:
            for name in own_terms_of(controller):
                units = {**law_named(controller).units, **_UNITS}
                own.setdefault(name, OwnTerm(name, units.get(name, "").replace(" ", "·")))
    return list(own.values())


def gains_told(views: Sequence[RunView]) -> bool:
    """Return True if any run has gains to show, or nothing else is known of its law."""
    known = [name for view in views for name in view.controllers if name in CONTROLLERS]
    return not known or any(map(tells_gains, known))


def values_of_term(view: RunView, term: OwnTerm) -> Floats:
    """Return a term at the run's states: of the last update, NaN before it and where a law has none."""
    t_ns = np.rint(view.table.t * 1e9).astype(np.int64)
    values: Floats = np.full(len(t_ns), np.nan)
    for controller in view.controllers:
        if controller in CONTROLLERS and term.name in law_named(controller).terms._fields:
            state, column = topics.controller_state(controller), ("position", term.name)
            recorded = view.run.series({state: [column]})[state]
            held = held_at(t_ns, recorded.stamp_ns, recorded.column(*column))
            values = np.where(np.isnan(values), held, values)
    return values
