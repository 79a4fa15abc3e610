"""The options that make a plan, and the plan that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import click

from ..plans.files import checked_external
from ..plans.nodes import CONTROLLERS, UNUSABLE
from ..plans.plan import RunPlan, make_plan, parse_swap
from ..results import Result
from .options import (
    FiniteRange,
    Function,
    Name,
    Number,
    exclude,
    names_or_files,
    parameter_files,
    scenarios,
)
from .terminal import show_warnings

# Limits of a push by hand, unless a file or --set gives others: the trunk's controllers can stand these.
HAND = {"operator.force": 100.0, "operator.torque": 40.0}


class ControllerName(Name):
    """The name of a controller that can be used here; for any other, the error says why it cannot."""

    hint = "; build and source your own package first"

    def __init__(self) -> None:
        super().__init__(CONTROLLERS)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name. Raises click.BadParameter."""
        if value in UNUSABLE:
            self.fail(UNUSABLE[value], param, ctx)
        return super().convert(value, param, ctx)


def markers_option(function: Function) -> Function:
    """Add ``--markers``, for the verbs that record."""
    return click.option(
        "--markers",
        is_flag=True,
        help="Also record a picture for Foxglove's and RViz's 3-D views: markers, tf, robot_description.",
    )(function)


def push_option(function: Function) -> Function:
    """Add ``--push``, for the verbs that run a scenario."""
    return click.option(
        "--push",
        "pushes",
        multiple=True,
        metavar="[CHANNEL=]VALUE:DURATION[@TIME]",
        help="A pulse besides the scenario's disturbances, such as 60Nm:0.1s@3 or hip_effort=300N:50ms@2.5s; "
        "repeatable.",
    )(function)


def parameter_options(function: Function) -> Function:
    """Add ``--params`` and ``--set``."""
    function = click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="NODE.PARAM=VALUE",
        help="One value, overrides all files; in SI units, or with a unit, such as 45deg; repeatable.",
    )(function)
    return click.option(
        "--params",
        multiple=True,
        metavar="FILE",
        help="A parameter file, by path or shipped name; repeatable, later ones win.",
        shell_complete=names_or_files(parameter_files),
    )(function)


def loop_options(function: Function) -> Function:
    """Add ``--params``, ``--set`` and ``--rate``, from which `loop_plan` makes the plan of a sampled loop."""
    function = click.option(
        "--rate",
        type=FiniteRange(0.001, 1e6, unit="Hz"),
        metavar="HZ",
        help="update_rate of the sampled loop, Hz.",
    )(function)
    return parameter_options(function)


def loop_plan(
    controller: str,
    params: tuple[str, ...],
    settings: tuple[str, ...],
    rate: float | None,
    scenario: str = "fig6",
) -> RunPlan:
    """Return the plan of a loop whose profile is profile_practical unless ``params`` give another."""
    everywhere = {} if rate is None else {"update_rate": rate}
    return make_plan(scenario, controller, ("profile_practical", *params), settings, everywhere)


def plan_options(
    function: Function,
    required: bool = True,
    several: tuple[str, ...] = (),
    of_several: str = "The first one acts, the others stand by; repeatable.",
) -> Function:
    """Add the argument and options from which `plan_of` makes a plan.

    ``several``: the default of a verb that takes several controllers, and what it says ``of_several``.
    """
    options = [
        click.argument("scenario", required=required, shell_complete=names_or_files(scenarios)),
        click.option(
            "--controller",
            default=list(several) or "fuzzy_pid",
            show_default=True,
            type=ControllerName(),
            multiple=bool(several),
            help=of_several if several else "The controller node.",
        ),
        parameter_options,
        click.option(
            "--swap-at",
            "swaps",
            multiple=True,
            metavar="T:CONTROLLER",
            help="Another controller takes over at T s, starting from the torque applied then; repeatable.",
        ),
        click.option(
            "--duration",
            type=Number("s"),
            metavar="S",
            help="Simulated time in s, or with another unit, such as 2min.",
        ),
        click.option(
            "--rate",
            type=Number("Hz"),
            metavar="HZ",
            help="update_rate of simulator and controller in Hz, or with another unit, such as 1kHz.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def external_option(function: Function) -> Function:
    """Add ``--external``, for the verbs that run in the graph."""
    return click.option(
        "--external",
        is_flag=False,
        flag_value="",
        metavar="[NAME]",
        help="Your own node gives the commands, instead of a controller of ours; the run goes by NAME, "
        "or by the node's name.",
    )(function)


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
    standby: Sequence[str] = (),
    below: Mapping[str, object] | None = None,
    external: str | None = None,
    pushes: Sequence[str] = (),
) -> RunPlan:
    """Return the plan for the options of `plan_options`, with ``extra`` for all nodes.

    ``below``: values for all nodes that declare them, where nothing else sets them.
    """
    if external is not None:
        exclude("--external: your own node gives the commands", "controller", "swaps")
        external = checked_external(external)
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
        standby=standby,
        below=below,
        external=external,
        pushes=pushes,
        source="--",
    )
    show_warnings(plan.warnings)
    return plan


@dataclass(frozen=True)
class PlanResult(Result):
    """What every document says about a plan."""

    scenario: str
    controllers: Annotated[tuple[str, ...], "All of the plan"]
    duration_s: Annotated[float, "0: without an end"]
    update_rate_hz: Annotated[float, "The simulator's"]


def about_plan(plan: RunPlan) -> PlanResult:
    """Return the facts about a plan that documents have."""
    simulator = plan.simulator
    names = tuple(plan.controllers)
    return PlanResult(plan.scenario, names, simulator.duration, simulator.update_rate)


def files_read(options: dict[str, Any]) -> list[str]:
    """Return the files that the options of `plan_options` name: scenario, parameters, by path or name."""
    return [name for name in (options.get("scenario"), *options.get("params", ())) if name]
