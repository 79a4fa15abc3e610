"""``trunk params show``: what a parameter file or a scenario sets, with units and rule tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import click

from trunk_msgs_util.parameters.declarations import Declaration

from ...console.document import json_option, write_json
from ...console.options import names_or_files, parameter_files
from ...results import OMITTED, Keyword, Result

if TYPE_CHECKING:
    from trunk_msgs_util.parameters.files import Layer, Section


class FileValue(NamedTuple):
    """One value of a file, and what declares it, if anything does."""

    nodes: Annotated[str, "As written there"]
    name: str
    value: object
    unit: Annotated[str, "Empty: none, or not declared"]
    file: str
    declaration: Annotated[Declaration | None, OMITTED]


@dataclass(frozen=True)
class ParamsShowResult(Result, document="params-show-1"):
    """The document of ``trunk params show``."""

    files: Annotated[Sequence[str], Keyword("minItems", 1), "Later ones win"]
    values: Sequence[FileValue]


@click.command("show")
@click.argument("name", shell_complete=names_or_files(parameter_files))
@json_option(ParamsShowResult)
def show(name: str, as_json: bool) -> None:
    """Print what a parameter file sets: paths, values, units, rule tables.

    NAME is a shipped name or a path. A scenario is shown with the profile that it builds on; later files win.
    """
    from trunk_msgs_util.parameters.files import ParameterFileError, check_names, read

    from ...console.terminal import show_warnings
    from ...plans.files import SCENARIOS, find_file, scenario_layers
    from ...plans.nodes import declared_names

    layers = scenario_layers(name) if name in SCENARIOS else [read(find_file(name))]
    values = shown(layers)
    if as_json:
        files = [layer.source for layer in layers]
        write_json(ParamsShowResult(files, values))
    else:
        _print(layers, values)
    try:
        check_names(layers, declared_names())
    except ParameterFileError as error:
        show_warnings([str(error)])
    show_warnings(_refused(values))


def shown(layers: Iterable[Layer]) -> list[FileValue]:
    """Return each value of some layers, the last one where several set the same for the same nodes."""
    values = {
        (section.pattern, name): FileValue(
            section.pattern, name, value, known.unit if known else "", layer.source, known
        )
        for layer in layers
        for section in layer.sections
        for name, value in section.values.items()
        for known in [_declaration(section, name)]
    }
    return list(values.values())


def _declaration(section: Section, name: str) -> Declaration | None:
    """Return the declaration of a section's parameter: of the first of our nodes that has it."""
    from trunk_msgs_util.parameters.declarations import listed

    from ...plans.nodes import NODES

    for node, kind in NODES.items():
        if section.last_token == node or section.matches(f"/{node}"):
            declared = listed(kind.config)
            if name in declared:
                return declared[name]
    return None


def _refused(values: Iterable[FileValue]) -> Iterable[str]:
    from trunk_msgs_util.parameters.declarations import ParameterError, check
    from trunk_msgs_util.parameters.to_si import to_si

    values = list(values)
    for nodes, name, value, _, source, declaration in values:
        if declaration is not None:
            # The parameter that chooses its unit may be in the same section.
            section = {other.name: other.value for other in values if other.nodes == nodes}
            try:
                check(declaration, to_si({name: declaration}, {name: value}, section)[name])
            except ParameterError as error:
                yield f"{source}: {nodes}: {error}"


def _print(layers: list[Layer], values: list[FileValue]) -> None:
    from trunk_control.rule_tables import axes_of, is_table

    from ...console.tables import print_table
    from ...console.terminal import print_title
    from .text import rule_table_text, value_text

    for layer in layers:
        click.echo(layer.source)
        for line in _head(Path(layer.source)):
            click.echo(f"  {line}")
    click.echo()
    sections: dict[str, list[FileValue]] = {}
    for shown in values:
        sections.setdefault(shown.nodes, []).append(shown)
    for nodes, section in sections.items():
        rows = [
            (
                shown.name,
                value_text(shown.value),
                shown.unit,
                shown.declaration.description if shown.declaration else "",
            )
            for shown in section
            if not is_table(shown.value)
        ]
        if rows:
            print_table(nodes, ("parameter", "value", "unit", "what"), rows, 3, sentences=True)
        else:
            print_title(nodes)
        for shown in section:
            if is_table(shown.value):
                given = {other.name: other.value for other in section}
                text = rule_table_text(shown.value, axes_of(shown.value, given))  # type: ignore[arg-type]
                click.echo(f"  {shown.name}\n{text}\n")


def _head(path: Path) -> list[str]:
    """Return a file's first lines of comment: what it is for."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return lines
