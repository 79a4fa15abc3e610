"""What several verbs share: types of options, and what a shell completes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from trunk_msgs_util.parameters.declarations import UnitError
from trunk_msgs_util.parameters.to_si import number_in

from ..errors import PlanError, did_you_mean

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]

Function = TypeVar("Function", bound=Callable[..., Any])


def exclude(reason: str, *names: str, but: Iterable[str] = ()) -> None:
    """Refuse parameters that were given and would be ignored: ``names``, or all ``but`` some.

    Raises PlanError with the reason.
    """
    context = click.get_current_context()
    for parameter in context.command.params:
        name = str(parameter.name)
        excluded = name in names if names else name not in but
        if excluded and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            word = parameter.opts[0] if isinstance(parameter, click.Option) else name.upper()
            raise PlanError(f"{reason}: leave out {word}")


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


class WholeRange(click.IntRange):
    """A range of integers, in ASCII digits without underscores."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the integer. Raises click.BadParameter if it is not one or not in the range."""
        if isinstance(value, str) and ("_" in value or not value.isascii()):
            self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)
        number: int = super().convert(value, param, ctx)
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


def jobs_option(text: str) -> Callable[[Function], Function]:
    """Return a decorator that adds ``--jobs``, None for as many as `workers.cores`."""
    text += "  [default: one per core that may be used]"
    return click.option("--jobs", type=WholeRange(1, 1024), help=text)


def device_option(function: Function) -> Function:
    """Add the option ``device``: what makes a study's runs."""
    return click.option(
        "--device",
        type=click.Choice(("cpu", "cuda")),
        default="cpu",
        show_default=True,
        help="Where runs are made: cuda, a GPU, gives the same bits; docs/sweep.md.",
    )(function)


def results_argument(function: Function) -> Function:
    """Add the argument ``results``: the Parquet file of a sweep."""
    kind = click.Path(path_type=Path, exists=True, dir_okay=False)
    return click.argument("results", metavar="OUT.parquet", type=kind)(function)


def names_or_files(known: Callable[[], Iterable[str]]) -> Complete:
    """Return a completion of names, or of files if no name begins with what was typed."""

    def complete(
        _context: click.Context, _parameter: click.Parameter, begun: str
    ) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        items = [CompletionItem(name) for name in known() if name.startswith(begun)]
        return items or [CompletionItem(begun, type="file")]

    return complete


def scenarios() -> Iterable[str]:
    """Return the shipped scenarios."""
    from ..plans.files import SCENARIOS

    return SCENARIOS


def parameter_files() -> Iterable[str]:
    """Return the shipped parameter files."""
    from ..plans.files import shipped_files

    return shipped_files()


def studies() -> Iterable[str]:
    """Return the shipped studies."""
    from ..study.study import shipped_studies

    return shipped_studies()


def nodes() -> Iterable[str]:
    """Return the nodes' names, without a namespace."""
    from ..plans.nodes import NODES

    return NODES
