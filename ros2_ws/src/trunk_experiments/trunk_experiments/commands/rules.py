"""``trunk rules``: rule bases of other programs, read as parameters and written."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import click

from trunk_core.errors import PlanError
from trunk_core.files import atomic_write
from trunk_core.parameters.parameter_files import read, write
from trunk_core.results import Keyword, Result

from ..console.document import json_option, write_json
from ..console.options import (
    ControllerName,
    FiniteRange,
    check_output,
    output_options,
    parameter_options,
)
from ..console.terminal import show_warnings
from ..console.verbs import Verbs

_INPUTS = {"e": "e", "e_dot": "e_dot", "ė": "e_dot"}
_OUTPUTS = {name: name for name in ("u", "kp", "kd", "alpha")}
_FILE = click.Path(path_type=Path)


Peaks = Annotated[int, Keyword("minimum", 2), Keyword("maximum", 64)]


class ImportedPeaks(NamedTuple):
    """How many peaks the table has."""

    error: Peaks
    rate: Peaks


class ImportedDeviation(NamedTuple):
    """The greatest deviation from the file, and where it is."""

    output: Annotated[str, Keyword("enum", ("u", "kp", "kd", "alpha"))]
    share: Annotated[float, "Of the output's span"]
    distance: Annotated[float, "In the file's unit"]
    error: float
    rate: float


@dataclass(frozen=True)
class ImportRulesResult(Result, document="rules-read-1"):
    """The document of ``trunk rules read``."""

    file: Path
    controller: Annotated[str, Keyword("enum", ("fuzzy_pid", "fuzzy"))]
    output: Annotated[Path, "The parameter file"]
    picture: Annotated[Path | None, "null: none asked for"]
    exact: Annotated[bool, "Nothing deviates but by rounding"]
    peaks: ImportedPeaks
    deviation: Annotated[ImportedDeviation, "The greatest of 100,000 points"]
    silent_terms: Annotated[Sequence[str], "variable: term, those that are 0 over the whole range"]
    parameters: Annotated[Mapping[str, object], "The controller's"]


@click.group("rules", cls=Verbs)
def command() -> None:
    """Read rules of MATLAB, Octave, fuzzylite or IEC 61131-7, or write them."""


@command.command("read")
@click.argument("file", type=_FILE)
@click.option(
    "--input",
    "inputs",
    multiple=True,
    metavar="e|e_dot=NAME",
    help="Which input of the file is the error, which its rate (also ė=); the other follows.",
)
@click.option(
    "--output-variable",
    "outputs",
    multiple=True,
    metavar="u|kp|kd|alpha=NAME",
    help="Which output is the command, or Kp, Kd and alpha; a number is a constant.",
)
@output_options("The ROS 2 parameter file to write, for --params or --params-file.", required=True)
@click.option(
    "--tolerance",
    type=FiniteRange(1e-9, 10.0),
    default=0.01,
    show_default=True,
    help="Greatest deviation of a table that cannot be exact, as a share of the output's span.",
)
@click.option("--picture", type=_FILE, help="Both surfaces and their difference; .png, .svg, .pdf.")
@json_option(ImportRulesResult)
def read_command(
    file: Path,
    inputs: Sequence[str],
    outputs: Sequence[str],
    output: Path,
    force: bool,
    tolerance: float,
    picture: Path | None,
    as_json: bool,
) -> None:
    """Take over the rules of a .fis (MATLAB, Octave), .fll (fuzzylite) or .fcl (IEC 61131-7) file.

    The rules become a table: exact where the file interpolates between its peaks as fuzzy_pid and fuzzy do,
    else sampled at up to 64 x 64 peaks. The greatest deviation from pyfuzzylite over 100,000 points is
    printed.
    """
    check_output(output, (".yaml", ".yml"), force, [file])
    if picture is not None:
        from trunk_views.plots import SUFFIXES

        check_output(
            picture, tuple(SUFFIXES), force, [file, output], "--picture", chooses_format=True
        )
    names = _pairs("--input", inputs, _INPUTS), _pairs("--output-variable", outputs, _OUTPUTS)
    from trunk_control.rulebase.importing import import_rules

    imported = import_rules(file, *names, tolerance)
    if picture is not None:
        from trunk_views.plots import save
        from trunk_views.rule_plots import both_surfaces

        table = imported.table
        figure = both_surfaces(
            imported.outputs,
            (table.error_peaks, table.rate_peaks),
            imported.surface,
            table.at,
            f"{file.name}: {imported.text}",
        )
        save(figure, picture)
    write(output, {imported.node: imported.values})
    show_warnings(f"{term} is 0 over the whole range" for term in imported.silent)
    if as_json:
        d = imported.deviation
        result = ImportRulesResult(
            file,
            imported.node,
            output,
            picture,
            imported.exact,
            ImportedPeaks(*imported.peaks),
            ImportedDeviation(imported.output, d.share, d.distance, d.error, d.rate),
            imported.silent,
            imported.values,
        )
        write_json(result)
        return
    click.echo(f"{file}: {imported.text}")
    if picture is not None:
        click.echo(f"picture: {picture}")
    click.echo(f"{output}: for --controller {imported.node} --params {output}")


def _pairs(option: str, texts: Sequence[str], keys: dict[str, str]) -> dict[str, str]:
    """Return KEY=NAME as pairs. Raises PlanError for another key, and for one that is there twice."""
    pairs: dict[str, str] = {}
    for text in texts:
        key, equals, name = text.partition("=")
        key = keys.get(unicodedata.normalize("NFC", key.strip()), "")
        if not equals or not name.strip() or not key or key in pairs:
            raise PlanError(
                f"{option} {text!r}: give {', '.join(f'{k}=NAME' for k in keys)}, each once"
            )
        pairs[key] = name.strip()
    return pairs


@dataclass(frozen=True)
class ExportRulesResult(Result, document="rules-write-1"):
    """The document of ``trunk rules write``."""

    controller: str
    output: Path
    rules: Annotated[int, Keyword("minimum", 4)]
    outputs: Annotated[list[Literal["u", "kp", "kd", "alpha"]], Keyword("minItems", 1)]


@command.command("write")
@click.option(
    "--controller",
    type=ControllerName(),
    help="The controller that has the rules.  [default: the one in the files]",
)
@parameter_options
@output_options("The file: .fis (MATLAB, Octave) or .fll (fuzzylite).", required=True)
@json_option(ExportRulesResult)
def write_command(
    controller: str | None,
    params: Sequence[str],
    settings: Sequence[str],
    output: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Write the rules of a controller for MATLAB, Octave or fuzzylite.

    Inputs e in rad and e_dot in rad/s; outputs kp and kd from 0 to 1 and alpha, or u in N m. trunk rules
    read takes the file back into the same parameters.
    """
    from trunk_control.rulebase.exporting import FORMATS, written
    from trunk_runs.plan import make_plan

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
    from trunk_runs.scenario import find_file

    for name in reversed(params):
        sections = {section.last_token for section in read(find_file(name)).sections}
        for controller in ("fuzzy", "fuzzy_pid"):
            if controller in sections:
                return controller
    return "fuzzy_pid"
