"""Generated parts of docs/*.md; ``scripts/update_readme.sh`` inserts them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from . import api
from .api._reference import reference
from .commands.params.text import markdown_rows, markdown_table
from .plans.files import shipped_files
from .plans.nodes import CONTROLLERS, NODES

_SECTION = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def parameters_tables() -> str:
    """Return every node's parameters, a Markdown table each; what our controllers share is listed once."""
    rows = {node: markdown_rows(node) for node in NODES}
    ours = [name for name in CONTROLLERS if NODES[name].package == "trunk_control"]
    first, *others = (set(rows[name].values()) for name in ours)
    shared = first.intersection(*others)
    parts = []
    for node, kind in NODES.items():
        own = [row for row in rows[node].values() if node not in ours or row not in shared]
        if node == ours[0]:
            common = [row for row in rows[node].values() if row in shared]
            also = ", ".join(f"`{name}`" for name in ours)
            parts.append(f"## All controllers\n\nThe same for {also}.\n\n{markdown_table(common)}")
        besides = " It also has those of [all controllers](#all-controllers)." * (node in ours)
        parts.append(f"## {node}\n\nPackage `{kind.package}`.{besides}\n\n{markdown_table(own)}")
    return "\n\n".join(parts)


def files_table() -> str:
    """Return the shipped parameter files with the first line of each."""
    lines = ["| name | what |", "|---|---|"]
    for name, path in shipped_files().items():
        first = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        lines.append(f"| `{name}` | {first} |")
    return "\n".join(lines)


def api_reference() -> str:
    """Return the public names of the library with their signatures."""
    return reference(api)


_SECTIONS = {
    "api": api_reference,
    "parameters": parameters_tables,
    "files": files_table,
}


def refreshed(text: str) -> str:
    """Return a page's text with its generated sections regenerated."""
    return _SECTION.sub(lambda m: f"{m[1]}{_SECTIONS[m[2]]()}\n{m[3]}", text)


if __name__ == "__main__":
    for page in map(Path, sys.argv[1:]):
        page.write_text(refreshed(page.read_text(encoding="utf-8")), encoding="utf-8")
