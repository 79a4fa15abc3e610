"""What several verbs share: types of options."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import click

from trunk_msgs_util.parameters.declarations import UnitError
from trunk_msgs_util.parameters.to_si import number_in

from ..suggestions import did_you_mean

Function = TypeVar("Function", bound=Callable[..., Any])


class Number(click.ParamType[float]):
    """A number in a unit, or with another unit of the same dimension, as in ``100ms``."""

    name = "float"

    def __init__(self, unit: str) -> None:
        self.unit = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number in the unit. Raises click.BadParameter if it cannot be read."""
        try:
            return number_in(value, self.unit)
        except UnitError as error:
            self.fail(f"{value!r}: {error}", param, ctx)


class FiniteRange(click.FloatRange):
    """A range of floats in a unit that excludes NaN and, whatever its bounds, infinity."""

    def __init__(self, *args: Any, unit: str = "", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.unit = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number. Raises click.BadParameter if it is not one or not in the range."""
        number: float = super().convert(Number(self.unit).convert(value, param, ctx), param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Name(click.Choice[str]):
    """One of some names; for any other, the error suggests the closest, or else gives the ``hint``."""

    hint = ""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name. Raises click.BadParameter if there is no such name."""
        if value not in self.choices:
            known = ", ".join(map(str, self.choices))
            meant = did_you_mean(str(value), map(str, self.choices))
            self.fail(f"{value!r}: give one of {known}{meant or self.hint}", param, ctx)
        return str(value)


def file_option(*names: str, help: str, metavar: str = "FILE") -> Callable[[Function], Function]:  # noqa: A002
    """Return an option whose value is a path."""
    return click.option(*names, type=click.Path(path_type=Path), metavar=metavar, help=help)
