"""``trunk lab``: a scenario as a lab in one HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import click

from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import values_of
from trunk_core.parameters.parameter_files import Layer, read
from trunk_core.results import Keyword, Result
from trunk_runs.plan import RunPlan
from trunk_runs.scenario import find_file, parse_setting

from ..console.document import json_option, write_json
from ..console.options import (
    HAND,
    check_output,
    files_read,
    output_options,
    plan_of,
    plan_options,
    push_option,
)

_OF_SEVERAL = (
    "A controller of the lab; they run side by side, each on a trunk of its own; repeatable."
)


@dataclass(frozen=True)
class LabResult(Result, document="lab-1"):
    """The document of ``trunk lab``."""

    file: Path
    bytes: Annotated[int, Keyword("minimum", 1)]
    scenario: str
    controllers: Annotated[Sequence[str], Keyword("minItems", 1)]
    states: Annotated[int, Keyword("minimum", 1), "Of a whole run"]
    knobs: Annotated[list[str], "NODE.PARAM that the page can change"]
    commands: Annotated[
        Mapping[str, list[str]], "The words that make the page's run, by controller"
    ]


@click.command("lab")
@plan_options(several=("pid", "fuzzy_pid"), of_several=_OF_SEVERAL)
@push_option
@click.option(
    "--knob",
    "chosen",
    multiple=True,
    metavar="NODE.PARAM",
    help="A parameter that the page can change; repeatable.  [default: all that can be]",
)
@output_options("The HTML file to write.", required=True)
@json_option(LabResult)
def command(
    output: Path,
    force: bool,
    chosen: tuple[str, ...],
    as_json: bool,
    swaps: Sequence[str],
    **options: Any,
) -> None:
    """Write SCENARIO as a lab: one HTML file that runs it in a browser, with the bits of trunk simulate.

    It needs no server and asks no host for anything. Needs clang and lld here, and nothing there.
    """
    check_output(output, (".html",), force, files_read(options))
    if swaps:
        raise PlanError(
            "--swap-at: in a lab each controller acts alone, all the time: leave it out"
        )
    controllers: tuple[str, ...] = tuple(dict.fromkeys(options.pop("controller")))
    lab, size = write_lab(output, controllers, chosen, **options)
    knobs = [f"{node}.{name}" for node, names in lab["knobs"].items() for name in names]
    if as_json:
        scenario, states, commands = lab["scenario"], lab["states"], lab["commands"]
        write_json(LabResult(output, size, scenario, controllers, states, knobs, commands))
        return
    click.echo(
        f"{output}: {lab['scenario']}, {', '.join(controllers)}, {len(knobs)} knob{'s' * (len(knobs) != 1)}, "
        f"{size / 1000:.0f} kB; open it in a browser"
    )


def write_lab(
    path: Path, controllers: Sequence[str], chosen: Sequence[str] = (), **options: Any
) -> tuple[dict[str, Any], int]:
    """Write the lab of a scenario with these options; return its data, and its size in bytes.

    Raises PlanError, ParameterError, UntranslatableError and OSError.
    """
    from ..lab.data import lab_of, write

    unset = {"params": (), "settings": (), "pushes": (), "duration": None, "rate": None}
    plans, commands = {}, {}
    for name in controllers:
        plans[name], commands[name] = _plan(name, controllers, {**unset, **options})
    lab = lab_of(plans, commands, chosen)
    return lab, write(lab, path)


def _plan(
    name: str, controllers: Sequence[str], options: dict[str, Any]
) -> tuple[RunPlan, list[str]]:
    """Return the plan with one of the controllers, and the words of the command that runs it."""
    others = {other for other in controllers if other != name}
    files = [path for path in options["params"] if not _is_for(others, read(find_file(path)))]
    settings = [text for text in options["settings"] if not _is_for(others, parse_setting(text))]
    own = {**options, "params": files, "settings": settings}
    plan = plan_of(controller=name, below=HAND, **own)
    pushed = values_of(plan.simulator)
    hand = [f"simulator.{key}={value!r}" for key, value in HAND.items() if pushed[key] == value]
    words = ["trunk", "simulate", options["scenario"], "--controller", name]
    for option, values in (("--params", files), ("--set", [*settings, *hand])):
        words += [word for value in values for word in (option, value)]
    words += [word for push in options["pushes"] for word in ("--push", push)]
    for option in ("duration", "rate"):
        if options[option] is not None:
            words += [f"--{option}", repr(options[option])]
    return plan, words


def _is_for(controllers: Set[str], layer: Layer) -> bool:
    """Return True for a layer that sets parameters of some controllers, and of no other node."""
    return set() < {section.last_token for section in layer.sections} <= controllers
