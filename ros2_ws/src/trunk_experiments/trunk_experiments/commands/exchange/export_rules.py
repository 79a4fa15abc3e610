"""``trunk export fuzzy``: a controller's rules as a file for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from trunk_msgs_util.files import atomic_write
from trunk_msgs_util.parameters.files import read

from ...console.document import json_option, write_json
from ...console.outputs import check_output, output_options
from ...console.plan_options import ControllerName, parameter_options
from ...console.terminal import show_warnings
from ...errors import PlanError
from ...results import Keyword, Result


@dataclass(frozen=True)
class ExportRulesResult(Result, document="export-fuzzy-1"):
    """The document of ``trunk export fuzzy``."""

    controller: str
    output: Path
    rules: Annotated[int, Keyword("minimum", 4)]
    outputs: Annotated[list[Literal["u", "kp", "kd", "alpha"]], Keyword("minItems", 1)]


@click.command("fuzzy")
@click.option(
    "--controller", type=ControllerName(), help="Whose rules.  [default: whose the files have]"
)
@parameter_options
@output_options("The file: .fis (MATLAB, Octave) or .fll (fuzzylite).", required=True)
@json_option(ExportRulesResult)
def command(
    controller: str | None,
    params: Sequence[str],
    settings: Sequence[str],
    output: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Write the rules of a controller for MATLAB, Octave or fuzzylite.

    Inputs e in rad and e_dot in rad/s; outputs kp and kd from 0 to 1 and alpha, or u in N m. trunk import
    fuzzy reads the file back into the same parameters.
    """
    from ...plans.plan import make_plan
    from ...rulebase.exporting import FORMATS, written

    check_output(output, tuple(FORMATS), force, params, chooses_format=True)
    name = controller or _named(params)
    plan = make_plan("fig6", name, params, settings)
    show_warnings(plan.warnings)
    config: Any = plan.controller
    if not hasattr(config, "tables"):
        raise PlanError(f"--controller {name}: it has no rules: give fuzzy_pid or fuzzy")
    text = written(config, output.suffix.lower())
    with atomic_write(output) as part:
        part.write_text(text, encoding="utf-8")
    rules = len(config.error_peaks) * len(config.rate_peaks)
    names = [table.name for table in config.tables]
    if as_json:
        write_json(ExportRulesResult(name, output, rules, names))
        return
    click.echo(f"{output}: {rules} rules of {name} for {', '.join(names)}")


def _named(params: Sequence[str]) -> str:
    """Return the controller with rules whose parameters the last file has."""
    from ...plans.files import find_file

    for name in reversed(params):
        sections = {section.last_token for section in read(find_file(name)).sections}
        for controller in ("fuzzy", "fuzzy_pid"):
            if controller in sections:
                return controller
    return "fuzzy_pid"
