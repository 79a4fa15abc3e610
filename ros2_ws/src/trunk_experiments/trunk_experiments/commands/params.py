"""``trunk params``: every parameter that the nodes declare, from the declarations themselves."""

from __future__ import annotations

import json

import click

from trunk_msgs_util.declarations import Declaration, declarations

from ..nodes import NODES
from .common import print_table


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


def markdown(node: str) -> str:
    """Return a node's parameters as a Markdown table."""
    lines = ["| parameter | type | default | unit | allowed | what |", "|---|---|---|---|---|---|"]
    for declaration in declarations(NODES[node].config).values():
        allowed = ", ".join(declaration.choices) or declaration.bounds()
        default = default_text(declaration)
        if len(default) > 40:
            default = "see the table" if declaration.name.startswith("rules") else "even"
        cells = (
            f"`{declaration.name}`" + ("" if not declaration.fixed else " *"),
            declaration.kind + (f"[{declaration.length}]" if declaration.length else ""),
            default,
            declaration.unit,
            allowed.replace(">= ", "≥ ").replace("<= ", "≤ "),
            declaration.description,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


@click.command("params")
@click.argument("node", type=click.Choice(list(NODES)), required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--markdown", "as_markdown", is_flag=True, help="Print Markdown tables.")
def command(node: str | None, as_json: bool, as_markdown: bool) -> None:
    """List the parameters of NODE, or of all nodes; * marks those that are fixed at start."""
    nodes = [node] if node else list(NODES)
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
