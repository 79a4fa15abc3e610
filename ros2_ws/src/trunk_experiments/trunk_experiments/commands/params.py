"""``trunk params``: every parameter that the nodes declare, from the declarations themselves."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import click

from trunk_msgs_util.parameters.declarations import Declaration, declarations

from ..console.common import json_option
from ..console.tables import print_table
from ..plans.nodes import NODES


def default_text(declaration: Declaration) -> str:
    """Return a default value as it would be written in a parameter file."""
    value = declaration.default
    if isinstance(value, tuple):
        return "[" + ", ".join(_one(v) for v in value) + "]"
    return _one(value)


def _one(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = f"{value:.6g}"
        if text in ("inf", "-inf"):
            return text.replace("inf", ".inf")
        return text if any(c in text for c in ".e") else text + ".0"
    return str(value) or '""'


def _size(declaration: Declaration) -> str:
    if declaration.longest is not None:
        return f"[≤{declaration.longest}]"
    return f"[{declaration.length}]" if declaration.length is not None else ""


def markdown(node: str) -> str:
    """Return a node's parameters as a Markdown table."""
    lines = ["| parameter | type | default | unit | allowed | what |", "|---|---|---|---|---|---|"]
    for declaration in declarations(NODES[node].config).values():
        allowed = ", ".join(declaration.choices) or declaration.bounds()
        default = default_text(declaration)
        if len(default) > 40:
            default = "as printed" if declaration.name.startswith("rules") else "even"
        cells = (
            f"`{declaration.name}`" + ("" if not declaration.fixed else " *"),
            declaration.kind + _size(declaration),
            default,
            declaration.unit,
            allowed.replace(">= ", "≥ ").replace("<= ", "≤ "),
            declaration.description,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


class _Verb(click.Group):
    """A group that also takes a node's name, to list its parameters, in place of a command."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        found = super().get_command(ctx, cmd_name)
        if found is not None:
            return found
        if cmd_name not in NODES:
            names = ", ".join(NODES)
            raise click.UsageError(f"{cmd_name!r} is neither apply nor one of {names}", ctx)

        @click.command(cmd_name)
        @_listing_options
        def of_one_node(as_json: bool, as_markdown: bool) -> None:
            """List the node's parameters; * marks those that are fixed at start."""
            given = ctx.params
            _list([cmd_name], as_json or given["as_json"], as_markdown or given["as_markdown"])

        return of_one_node


def _listing_options(function: Any) -> Any:
    function = click.option("--markdown", "as_markdown", is_flag=True, help="Print Markdown.")(
        function
    )
    return json_option()(function)


@click.group(
    "params",
    cls=_Verb,
    invoke_without_command=True,
    subcommand_metavar="[NODE | apply RUNNING_NODE FILE]",
)
@_listing_options
@click.pass_context
def command(ctx: click.Context, as_json: bool, as_markdown: bool) -> None:
    """List the parameters of NODE, or of all nodes; * marks those that are fixed at start.

    apply changes those of a running node.
    """
    if ctx.invoked_subcommand is None:
        _list(list(NODES), as_json, as_markdown)


@command.command("apply")
@click.argument("node")
@click.argument("file")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.0, min_open=True, max=3600.0),
    default=5.0,
    show_default=True,
    metavar="S",
    help="How long the node may take to be found, and to answer.",
)
@click.option("--dry-run", is_flag=True, help="Show what differs; change nothing.")
def apply(node: str, file: str, timeout: float, dry_run: bool) -> None:
    """Set the parameters of the running NODE to its values in FILE: all at once, or none.

    NODE is a node's name, such as pid or /robot2/pid; FILE a parameter file, by path or shipped name.
    """
    from trunk_msgs_util.parameters.files import read

    from ..errors import LiveParametersError
    from ..live.parameters import differences, full_name, said_of
    from ..plans.files import find_file

    layer, name = read(find_file(file)), full_name(node)
    from ..live.parameters_node import LiveParameters

    with LiveParameters(name, timeout) as parameters:
        said = said_of(name, layer, parameters.names())
        present, fixed = parameters.values(list(said)), parameters.fixed(list(said))
        changes = differences(said, present, fixed)
        refused = [change for change in changes if change.fixed]
        if refused and not dry_run:
            listed = "; ".join(map(str, refused))
            raise LiveParametersError(
                f"{name}: {listed}: nothing is changed; leave it out, or start the node with {file}"
            )
        if changes and not dry_run:
            parameters.set_together({change.name: change.new for change in changes})
    for change in changes:
        click.echo(str(change))
    if not changes:
        click.echo("nothing to change")


def _list(nodes: Sequence[str], as_json: bool, as_markdown: bool) -> None:
    if as_json:
        listing = {
            name: {
                d.name: {
                    "type": d.kind,
                    "default": d.default
                    if d.default not in (float("inf"), float("-inf"))
                    else str(d.default),
                    "unit": d.unit,
                    "allowed": d.allowed(),
                    "description": d.description,
                    "fixed": d.fixed,
                }
                for d in declarations(NODES[name].config).values()
            }
            for name in nodes
        }
        click.echo(json.dumps(listing, indent=2))
        return
    for name in nodes:
        if as_markdown:
            click.echo(f"### {name}\n\n{markdown(name)}\n")
            continue
        print_table(
            name,
            ("parameter", "default", "unit", "what"),
            [
                (d.name + (" *" if d.fixed else ""), default_text(d), d.unit, d.description)
                for d in declarations(NODES[name].config).values()
            ],
        )
