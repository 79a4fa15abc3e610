"""What several verbs share: the options that make a plan, and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from trunk_msgs_util.printable import printable

from ..plans.nodes import CONTROLLERS
from ..plans.plan import RunPlan, make_plan
from ..plans.turns import parse_swap
from ..similar import did_you_mean
from .complete import names_or_files, parameter_files, scenarios
from .terminal import console

Function = TypeVar("Function", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """A range of floats that excludes NaN and, whatever its ends, infinity."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number. Raises click.BadParameter if it is not one or not in the range."""
        number: float = super().convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Name(click.Choice[str]):
    """One of some names; for another one it says which was meant."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name. Raises click.BadParameter if there is no such name."""
        if value not in self.choices:
            known = ", ".join(map(str, self.choices))
            meant = did_you_mean(str(value), map(str, self.choices))
            self.fail(f"{value!r}: give one of {known}{meant}", param, ctx)
        return str(value)


def file_option(*names: str, help: str, metavar: str = "FILE") -> Callable[[Function], Function]:  # noqa: A002
    """Return an option whose value is a path."""
    return click.option(*names, type=click.Path(path_type=Path), metavar=metavar, help=help)


def json_option(text: str = "Print JSON.") -> Callable[[Function], Function]:
    """Return the option ``--json`` of a verb whose result can be printed for programs."""
    return click.option("--json", "as_json", is_flag=True, help=text)


def markers_option(function: Function) -> Function:
    """Add ``--markers``, of the verbs that record."""
    return click.option(
        "--markers",
        is_flag=True,
        help="Record a picture too, for Foxglove's and RViz's 3-D views: markers, tf, robot_description.",
    )(function)


def plan_options(function: Function, required: bool = True) -> Function:
    """Add the argument and options from which `plan_of` makes a plan."""
    options = [
        click.argument("scenario", required=required, shell_complete=names_or_files(scenarios)),
        click.option(
            "--controller",
            default="fuzzy_pid",
            show_default=True,
            type=Name(CONTROLLERS),
            help="The controller node.",
        ),
        click.option(
            "--params",
            multiple=True,
            metavar="FILE",
            help="A parameter file, by path or shipped name; repeatable, later ones win.",
            shell_complete=names_or_files(parameter_files),
        ),
        click.option(
            "--set",
            "settings",
            multiple=True,
            metavar="NODE.PARAM=VALUE",
            help="One value, overrides all files; repeatable.",
        ),
        click.option(
            "--swap-at",
            "swaps",
            multiple=True,
            metavar="T:CONTROLLER",
            help="Another controller takes over at T s, without a jump in torque; repeatable.",
        ),
        click.option("--duration", type=float, metavar="S", help="Simulated time, s."),
        click.option(
            "--rate", type=float, metavar="HZ", help="update_rate of simulator and controller, Hz."
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def plan_of(
    scenario: str,
    controller: str,
    params: Sequence[str],
    settings: Sequence[str],
    duration: float | None,
    rate: float | None,
    extra: Mapping[str, object] | None = None,
    namespace: str = "",
    swaps: Sequence[str] = (),
) -> RunPlan:
    """Return the plan for the options of `plan_options`, with ``extra`` for all nodes."""
    everywhere: dict[str, object] = dict(extra or {})
    if duration is not None:
        everywhere["duration"] = duration
    if rate is not None:
        everywhere["update_rate"] = rate
    plan = make_plan(
        scenario,
        controller,
        params,
        settings,
        everywhere,
        namespace,
        [parse_swap(text) for text in swaps],
    )
    for warning in plan.warnings:
        click.echo(f"trunk: warning: {warning}", err=True)
    return plan


def files_read(options: dict[str, Any]) -> list[str]:
    """Return what the options of `plan_options` name: a scenario and parameter files, by path or name."""
    return [name for name in (options.get("scenario"), *options.get("params", ())) if name]


_COLUMN = 15  # characters that a column of values needs with its margins


def print_table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1
) -> None:
    """Print a table: the first columns, of text, left, the others right; plain without a terminal.

    Names in the first column are not broken where that leaves room for the others.
    """
    screen, cells = console(), [tuple(map(printable, row)) for row in rows]
    # As Text: Rich would take what stands in brackets for its markup.
    table = Table(
        title=Text(printable(title)), box=SIMPLE_HEAD, title_justify="left", title_style="bold"
    )
    names = max((len(row[0]) for row in cells), default=0)
    room = screen.width - _COLUMN * (len(header) - 1)
    for i, column in enumerate(header):
        table.add_column(
            Text(printable(column)),
            justify="left" if i < texts else "right",
            overflow="fold",
            no_wrap=i == 0 and names <= room,
        )
    for row in cells:
        table.add_row(*map(Text, row))
    screen.print(table)
