"""The small panels of an overview: gains, or the terms of a law without gains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

from .own_terms import gains_told, own_terms, values_of_term

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Floats

    from .run_view import RunView


class Panel(NamedTuple):
    """A small panel over time: of a gain, or of a law's own term."""

    title: str
    label: str
    values: Callable[[RunView], Floats]


def _gain(title: str, symbol: str, unit: str, column: str) -> Panel:
    return Panel(f"{title} {symbol}", f"{symbol} ({unit})", attrgetter(f"table.{column}"))


_GAINS = (
    _gain("Gain", r"$K_p$", "N·m/rad", "kp"),
    _gain("Gain", r"$K_i$", "N·m/(rad·s)", "ki"),
    _gain("Gain", r"$K_d$", "N·m·s/rad", "kd"),
    _gain("Ratio", r"$\alpha$", "no unit", "alpha"),
)


def panels_of(views: Sequence[RunView]) -> Sequence[Panel]:
    """Return the gains' panels; for laws that tell none, those of up to four of their own terms."""
    if gains_told(views):
        return _GAINS
    return [
        Panel(term.name.replace("_", " "), term.title, partial(values_of_term, term=term))
        for term in own_terms(views)[:4]
    ]
