"""``trunk params``: every parameter that the nodes declare, files of them, and a running node's.

As text a value is as in a file, a rule table as in the paper.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import click

from trunk_core.parameters.declarations import Declaration, listed
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.results import OMITTED, Keyword, Result
from trunk_msgs_util.node import middleware
from trunk_runs.live_parameters import LiveChange
from trunk_runs.nodes import NODES, Parameter, config_class, parameters_of, why_not_with
from trunk_sim.plant import TRUNK

from ..console.document import json_option, write_json
from ..console.options import FiniteRange, nodes, parameter_files, together
from ..console.tables import aligned, markdown_table, print_table
from ..console.terminal import print_title, show_warnings
from ..console.verbs import Verbs

if TYPE_CHECKING:
    from trunk_control.rule_tables import Axes
    from trunk_core.parameters.parameter_files import Layer, Section

_TIMEOUT = FiniteRange(min=0.0, min_open=True, max=3600.0, unit="s")
_LONG = 24  # characters; a longer array is not listed in full


@dataclass(frozen=True)
class ParamsResult(Result, document="params-1"):
    """The document of ``trunk params``."""

    nodes: Annotated[Mapping[str, Mapping[str, Parameter]], "Parameters by node"]


class _Verb(Verbs):
    """A group that also takes a node's name, to list its parameters, in place of a command."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        verb = super().get_command(ctx, cmd_name)
        if verb is not None:
            return verb
        from trunk_core.errors import PlanError, did_you_mean

        if cmd_name not in NODES:
            if ctx.resilient_parsing:  # a shell completes
                return None
            names = ", ".join(NODES)
            meant = did_you_mean(cmd_name, [*self.commands, *NODES])
            raise PlanError(
                f"params {cmd_name!r}: give {', '.join(self.commands)}, or a node: {names}{meant}"
            )

        @click.command(cmd_name)
        @_listing_options
        def of_one_node(plant: str, as_json: bool, as_markdown: bool) -> None:
            """List the node's parameters; * marks those that are fixed at start."""
            given = ctx.params
            chosen = given["plant"] if plant == TRUNK else plant
            known = config_class("simulator", {PLANT_NAME: chosen}).kind.name
            if why := why_not_with(known, cmd_name):
                raise PlanError(why)
            as_json, as_markdown = as_json or given["as_json"], as_markdown or given["as_markdown"]
            _list([cmd_name], chosen, as_json, as_markdown)

        return of_one_node

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Complete commands, options and names of nodes."""
        from click.shell_completion import CompletionItem

        nodes = [CompletionItem(name) for name in NODES if name.startswith(incomplete)]
        return [*super().shell_complete(ctx, incomplete), *nodes]


_listing_options = together(
    json_option(ParamsResult),
    click.option("--plant", default=TRUNK, show_default=True, help="The plant of the run."),
    click.option("--markdown", "as_markdown", is_flag=True, help="Print Markdown."),
)


@click.group(
    "params",
    cls=_Verb,
    invoke_without_command=True,
    subcommand_metavar="[NODE | show NAME | set NODE NAME=VALUE... | apply NODE FILE]",
)
@_listing_options
@click.pass_context
def command(ctx: click.Context, plant: str, as_json: bool, as_markdown: bool) -> None:
    """List the parameters of NODE, or of all nodes; * marks those that are fixed at start.

    The names are as --set takes them. show prints a parameter file; set and apply change a running node.
    """
    if ctx.invoked_subcommand is None:
        nodes = [name for name in NODES if not why_not_with(plant, name)]
        _list(nodes, plant, as_json, as_markdown)


def _list(nodes: Sequence[str], plant: str, as_json: bool, as_markdown: bool) -> None:
    if as_json:
        write_json(ParamsResult({name: parameters_of(name, plant) for name in nodes}))
        return
    for name in nodes:
        if as_markdown:
            click.echo(f"### {name}\n\n{markdown(name, plant)}\n")
            continue
        print_table(
            f"{name} (* fixed at start)",
            ("parameter", "default", "unit", "allowed", "what"),
            [
                (
                    f"{name}.{d.name}" + (" *" if d.fixed else ""),
                    short_text(d.default),
                    d.unit,
                    allowed_text(d),
                    d.description,
                )
                for d in listed(config_class(name, {PLANT_NAME: plant})).values()
            ],
            texts=4,
            sentences=True,
        )


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
@click.argument("name", shell_complete=parameter_files)
@json_option(ParamsShowResult)
def show(name: str, as_json: bool) -> None:
    """Print what a parameter file sets: paths, values, units, rule tables.

    NAME is a shipped name or a path. A scenario is shown with the profile that it builds on; later files win.
    """
    from trunk_core.parameters.parameter_files import ParameterFileError, check_names, read
    from trunk_runs.nodes import declared_names
    from trunk_runs.scenario import SCENARIOS, find_file, plant_of, scenario_layers

    layers = scenario_layers(name) if name in SCENARIOS else [read(find_file(name))]
    plant = plant_of(layers, "").name
    values = shown(layers, plant)
    if as_json:
        files = [layer.source for layer in layers]
        write_json(ParamsShowResult(files, values))
    else:
        _print(layers, values)
    try:
        check_names(layers, declared_names(plant))
    except ParameterFileError as error:
        show_warnings([str(error)])
    show_warnings(_refused(values))


def shown(layers: Iterable[Layer], plant: str) -> list[FileValue]:
    """Return each value of some layers, the last one where several set the same for the same nodes."""
    values = {
        (section.pattern, name): FileValue(
            section.pattern, name, value, known.unit if known else "", layer.source, known
        )
        for layer in layers
        for section in layer.sections
        for name, value in section.values.items()
        for known in [_declaration(section, name, plant)]
    }
    return list(values.values())


def _declaration(section: Section, name: str, plant: str) -> Declaration | None:
    """Return the declaration of a section's parameter: of the first of our nodes that has it."""
    for node in NODES:
        if section.last_token == node or section.matches(f"/{node}"):
            declared = listed(config_class(node, {PLANT_NAME: plant}))
            if name in declared:
                return declared[name]
    return None


def _refused(values: Iterable[FileValue]) -> Iterable[str]:
    from trunk_core.parameters.declarations import ParameterError, check
    from trunk_core.parameters.to_si import to_si

    values = list(values)
    for pattern, name, value, _, source, declaration in values:
        if declaration is not None:
            # The parameter that chooses its unit may be in the same section.
            section = {other.name: other.value for other in values if other.nodes == pattern}
            try:
                check(declaration, to_si({name: declaration}, {name: value}, section)[name])
            except ParameterError as error:
                yield f"{source}: {pattern}: {error}"


def _print(layers: list[Layer], values: list[FileValue]) -> None:
    from trunk_control.rule_tables import axes_of, is_table

    for layer in layers:
        click.echo(layer.source)
        for line in _head(Path(layer.source)):
            click.echo(f"  {line}")
    click.echo()
    sections: dict[str, list[FileValue]] = {}
    for shown in values:
        sections.setdefault(shown.nodes, []).append(shown)
    for pattern, section in sections.items():
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
            print_table(pattern, ("parameter", "value", "unit", "what"), rows, 3, sentences=True)
        else:
            print_title(pattern)
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


@dataclass(frozen=True)
class ParamsApplyResult(Result, document="params-apply-1"):
    """The document of ``trunk params apply``, set."""

    node: str
    applied: Annotated[bool, "false: --dry-run"]
    changes: Sequence[LiveChange]


_live_options = together(
    click.option("--namespace", default="", help="Namespace of the node, such as robot1."),
    json_option(ParamsApplyResult),
    click.option(
        "--timeout",
        type=_TIMEOUT,
        default=5.0,
        show_default=True,
        metavar="S",
        help="How long the node may take to be found, and to answer.",
    ),
    click.option("--dry-run", is_flag=True, help="Show what differs; change nothing."),
)


@click.command("apply")
@click.argument("node", shell_complete=nodes)
@click.argument("file", shell_complete=parameter_files)
@_live_options
def apply(
    node: str, file: str, namespace: str, timeout: float, dry_run: bool, as_json: bool
) -> None:
    """Set the parameters of the running NODE to its values in FILE: all at once, or none.

    NODE is a node's name, such as pid or /robot2/pid; FILE a parameter file, by path or shipped name.
    """
    from trunk_core.parameters.parameter_files import read
    from trunk_runs.live_parameters import full_name
    from trunk_runs.scenario import checked_namespace, find_file

    layer, name = read(find_file(file)), full_name(node, checked_namespace(namespace))
    _set(name, layer, timeout, dry_run, as_json, file)


@click.command("set")
@click.argument("node", shell_complete=nodes)
@click.argument("settings", nargs=-1, required=True, metavar="NAME=VALUE...")
@_live_options
def set_values(
    node: str,
    settings: tuple[str, ...],
    namespace: str,
    timeout: float,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Set parameters of the running NODE: all at once, or none.

    NODE is a node's name, such as pid or /robot2/pid; VALUE is written as in a parameter file. If the
    node refuses, its own message is printed, and nothing has changed.
    """
    from trunk_core.parameters.parameter_files import Layer, Section
    from trunk_runs.live_parameters import full_name
    from trunk_runs.scenario import checked_namespace, settings_of

    wanted = settings_of(settings)
    name = full_name(node, checked_namespace(namespace))
    _set(name, Layer("params set", (Section(name, wanted),)), timeout, dry_run, as_json)


def _set(
    name: str, layer: Layer, timeout: float, dry_run: bool, as_json: bool, file: str = ""
) -> None:
    """Set a running node's parameters to a layer's values, and say which change.

    Of a ``file`` those that are fixed are refused here, and those for other nodes are left out.
    """
    from trunk_core.errors import LiveParametersError
    from trunk_runs.live_parameters import (
        choosers_of,
        class_of,
        differences,
        planned_names,
        said_in_si,
        said_of,
        with_numbers,
        with_tables,
    )

    middleware.prepare()  # a middleware that is not there ends whoever imports rclpy
    from trunk_runs.live_parameters_node import LiveParameters

    said: Mapping[str, object]
    with LiveParameters(name, timeout) as parameters:
        names = parameters.names()
        config = class_of(name, names, parameters.values)
        said = layer.sections[0].values
        if file:
            said = said_of(name, layer, [*names, *planned_names(config)])
        said = with_numbers(name, config, layer, said, parameters.values)
        said = with_tables(name, config, layer.source, said, parameters.values)
        present = parameters.values([*said, *choosers_of(config, said)])
        fixed = parameters.fixed(list(said)) if file or dry_run else ()
        said = said_in_si(name, config, layer.source, said, present)
        changes = differences(said, present, fixed)
        refused = [change for change in changes if change.fixed]
        if refused and not dry_run:
            listed = "; ".join(map(str, refused))
            raise LiveParametersError(
                f"{name}: {listed}: nothing is changed; leave it out, or start the node with {file}"
            )
        if changes and not dry_run:
            parameters.set_together({change.name: change.new for change in changes})
    parent = click.get_current_context().parent
    if as_json or (parent is not None and parent.params["as_json"]):  # trunk params --json set
        write_json(ParamsApplyResult(name, not dry_run, changes))
        return
    for change in changes:
        click.echo(str(change))
    if not changes:
        click.echo("nothing to change")


for _command in (show, set_values, apply):
    command.add_command(_command)


def value_text(value: object) -> str:
    """Return a value as it would be written in a parameter file."""
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(_scalar_text, value)) + "]"
    return _scalar_text(value)


def short_text(value: object) -> str:
    """Return a value's text, or how many values there are where a line has no room for them."""
    text = value_text(value)
    if not isinstance(value, tuple | list) or len(text) <= _LONG:
        return text
    return f"({len(value)} values)"


def allowed_text(declaration: Declaration) -> str:
    """Return the allowed values besides the type: choices, or bounds; for an array, of each value."""
    size = f"{declaration.length} values" if declaration.length is not None else ""
    if declaration.longest is not None:
        least = f"{declaration.shortest} to" if declaration.shortest else "up to"
        size = f"{least} {declaration.longest} values"
    if declaration.table:
        return f"{size}; one cell: {declaration.name}.ROW.COLUMN"
    each = ", ".join(declaration.choices) or declaration.bounds()
    if declaration.kind == "bool":
        each = "true, false"
    return ", each ".join(filter(None, (size, each)))


def rule_table_text(rows: Sequence[str], axes: Axes) -> str:
    """Return a rule table with its labels: a row for each label of e, a column for each of e_dot."""
    cells: list[Sequence[str]] = [("e \\ e_dot", *axes.rate)]
    cells += [(label, *row.split()) for label, row in zip(axes.error, rows, strict=True)]
    return indent("\n".join(aligned(cells)), " " * 4)


def markdown(node: str, plant: str = TRUNK) -> str:
    """Return a node's parameters with a plant as a Markdown table."""
    rows = []
    for declaration in listed(config_class(node, {PLANT_NAME: plant})).values():
        allowed = ", ".join(declaration.choices) or declaration.bounds()
        default = value_text(declaration.default)
        if len(default) > 40:
            table = "antidiagonal" if declaration.name == "rules.u" else "as printed"
            default = table if declaration.table else "even"
        size = f"[{declaration.length}]" if declaration.length is not None else ""
        if declaration.longest is not None:
            least = f"{declaration.shortest}…" if declaration.shortest else "≤"
            size = f"[{least}{declaration.longest}]"
        rows.append(
            (
                f"`{declaration.name}`" + ("" if not declaration.fixed else " *"),
                declaration.kind + size,
                default,
                declaration.unit,
                allowed.replace(">= ", "≥ ").replace("<= ", "≤ "),
                declaration.description,
            )
        )
    return markdown_table(("parameter", "type", "default", "unit", "allowed", "what"), rows)


def _scalar_text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = f"{value:.6g}"
        if text in ("inf", "-inf"):
            return text.replace("inf", ".inf")
        return text if any(c in text for c in ".e") else text + ".0"
    return str(value) or '""'
