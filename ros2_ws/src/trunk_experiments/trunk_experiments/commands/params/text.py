"""Parameters as text: values as in a file, what is allowed, rule tables as in the paper, Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import indent

from trunk_control.rule_tables import Axes
from trunk_msgs_util.parameters.declarations import Declaration, listed

from ...console.tables import aligned
from ...plans.nodes import NODES

_LONG = 24  # characters; a longer array is not listed in full


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


def markdown_rows(node: str) -> dict[str, str]:
    """Return a node's parameters by name, each as a row of a Markdown table."""
    rows = {}
    for declaration in listed(NODES[node].config).values():
        allowed = ", ".join(declaration.choices) or declaration.bounds()
        default = value_text(declaration.default)
        if len(default) > 40:
            table = "antidiagonal" if declaration.name == "rules.u" else "as printed"
            default = table if declaration.table else "even"
        size = f"[{declaration.length}]" if declaration.length is not None else ""
        if declaration.longest is not None:
            least = f"{declaration.shortest}…" if declaration.shortest else "≤"
            size = f"[{least}{declaration.longest}]"
        cells = (
            f"`{declaration.name}`" + ("" if not declaration.fixed else " *"),
            declaration.kind + size,
            default,
            declaration.unit,
            allowed.replace(">= ", "≥ ").replace("<= ", "≤ "),
            declaration.description,
        )
        rows[declaration.name] = (
            "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
        )
    return rows


def markdown_table(rows: Iterable[str]) -> str:
    """Return rows of parameters as a Markdown table."""
    head = ("| parameter | type | default | unit | allowed | what |", "|---|---|---|---|---|---|")
    return "\n".join((*head, *rows))


def _scalar_text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = f"{value:.6g}"
        if text in ("inf", "-inf"):
            return text.replace("inf", ".inf")
        return text if any(c in text for c in ".e") else text + ".0"
    return str(value) or '""'
