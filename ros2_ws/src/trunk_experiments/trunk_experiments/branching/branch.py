"""What a branch changes, as the user asks for it, in words and for the record."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from ..errors import PlanError


class Branch(NamedTuple):
    """One branch of a run: from ``at`` s on, with these changes."""

    at: float
    settings: tuple[str, ...] = ()  # NODE.PARAM=VALUE
    controller: str = ""  # who acts from there on; empty: as recorded
    pushes: tuple[str, ...] = ()  # `pushes.parse_push`

    def describe(self) -> str:
        """Return the changes in a line."""
        changes = [f"controller {self.controller}"] if self.controller else []
        changes += [*self.settings, *(f"push {push}" for push in self.pushes)]
        return ", ".join(changes) or "nothing changed"


def fanned(branches: Sequence[Branch], grid: Sequence[str]) -> list[Branch]:
    """Return each branch with each combination of the values of ``NODE.PARAM=A,B,C``.

    Raises PlanError for a text without values.
    """
    axes: list[list[str]] = []
    for text in grid:
        target, equals, values = text.partition("=")
        options = [value.strip() for value in values.split(",")]
        if not equals or not target or not all(options):
            raise PlanError(f"--grid {text!r}: NODE.PARAM=A,B,C is needed")
        axes.append([f"{target}={value}" for value in options])
    return [
        branch._replace(settings=(*branch.settings, *chosen))
        for branch in branches
        for chosen in product(*axes)
    ]
