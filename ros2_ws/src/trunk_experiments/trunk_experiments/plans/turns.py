"""Controllers that take over from one another: who acts when, as the user asked."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from trunk_msgs_util.parameters.declarations import UnitError
from trunk_msgs_util.parameters.to_si import number_in

from ..errors import PlanError
from .nodes import CONTROLLERS


class Swap(NamedTuple):
    """A controller that takes over at a time in s."""

    time: float
    controller: str


def turns_of(first: str, swaps: Sequence[Swap]) -> dict[str, tuple[float, ...]]:
    """Return each controller's ``active.times``, by name in the order of their first turns.

    Raises PlanError for swaps whose times do not ascend, or that change nothing.
    """
    turns: dict[str, list[float]] = {first: [0.0]}
    now, acting = 0.0, first
    for time, name in swaps:
        if time <= now:
            raise PlanError(
                f"swap at {time:g}:{name}: times must be above 0 and ascend; the previous is {now:g}"
            )
        if name == acting:
            raise PlanError(f"swap at {time:g}:{name}: {name} is already acting then")
        turns[acting].append(time)
        turns.setdefault(name, []).append(time)
        now, acting = time, name
    return {name: tuple(times) for name, times in turns.items()}


def parse_swap(text: str) -> Swap:
    """Return the swap that ``T:CONTROLLER`` stands for, T in s or with a unit. Raises PlanError."""
    time_text, colon, name = text.partition(":")
    wrong = ""
    try:
        time = number_in(time_text, "s")
        if colon and name in CONTROLLERS and isfinite(time):
            return Swap(time, name)
    except UnitError as error:
        wrong = f"; T is {time_text!r}: {error}"
    raise PlanError(
        f"swap at {text!r}: T:CONTROLLER is needed, T in s, "
        f"CONTROLLER one of {', '.join(CONTROLLERS)}{wrong}"
    )
