"""``trunk params``: every parameter that the nodes declare, files of them, and a running node's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import click

from ...console.document import json_option, write_json
from ...console.verbs import Verbs
from ...plans.nodes import NODES, Parameter, parameters_of
from ...results import Result
from .live import apply, set_values
from .show import show


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
        from ...errors import PlanError, did_you_mean

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
        def of_one_node(as_json: bool, as_markdown: bool) -> None:
            """List the node's parameters; * marks those that are fixed at start."""
            given = ctx.params
            _list([cmd_name], as_json or given["as_json"], as_markdown or given["as_markdown"])

        return of_one_node

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Complete commands, options and names of nodes."""
        from click.shell_completion import CompletionItem

        nodes = [CompletionItem(name) for name in NODES if name.startswith(incomplete)]
        return [*super().shell_complete(ctx, incomplete), *nodes]


def _listing_options(function: Any) -> Any:
    function = click.option("--markdown", "as_markdown", is_flag=True, help="Print Markdown.")(
        function
    )
    return json_option(ParamsResult)(function)


@click.group(
    "params",
    cls=_Verb,
    invoke_without_command=True,
    subcommand_metavar="[NODE | show NAME | set NODE NAME=VALUE... | apply NODE FILE]",
)
@_listing_options
@click.pass_context
def command(ctx: click.Context, as_json: bool, as_markdown: bool) -> None:
    """List the parameters of NODE, or of all nodes; * marks those that are fixed at start.

    The names are as --set takes them. show prints a parameter file; set and apply change a running node.
    """
    if ctx.invoked_subcommand is None:
        _list(list(NODES), as_json, as_markdown)


for _command in (show, set_values, apply):
    command.add_command(_command)


def _list(nodes: Sequence[str], as_json: bool, as_markdown: bool) -> None:
    from trunk_msgs_util.parameters.declarations import listed

    from ...console.tables import print_table
    from .text import allowed_text, markdown_rows, markdown_table, short_text

    if as_json:
        write_json(ParamsResult({name: parameters_of(name) for name in nodes}))
        return
    for name in nodes:
        if as_markdown:
            click.echo(f"### {name}\n\n{markdown_table(markdown_rows(name).values())}\n")
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
                for d in listed(NODES[name].config).values()
            ],
            texts=4,
            sentences=True,
        )
