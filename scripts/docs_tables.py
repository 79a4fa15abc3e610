"""Write the tables that the site has and the repository has not: docs_tables.py FOLDER (scripts/docs.sh)."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import click

from trunk_experiments.cli import trunk
from trunk_experiments.commands import params
from trunk_experiments.console.document import JsonOption
from trunk_experiments.console.tables import markdown_table
from trunk_runs.nodes import NODES
from trunk_runs.scenario import shipped_files
from trunk_sim.plants import cart_pole as module


def parameters() -> str:
    """Return a table of each node's parameters."""
    tables = ((name, params.markdown(name)) for name in NODES)
    return "\n\n".join(f"### {name}\n\n{table}" for name, table in tables)


def files() -> str:
    """Return the shipped parameter files with the first line of each."""
    first = (
        (name, path.read_text("utf-8").splitlines()[0]) for name, path in shipped_files().items()
    )
    return markdown_table(
        ("name", "what"), [(f"`{name}`", line.lstrip("# ")) for name, line in first]
    )


def documents() -> str:
    """Return the verbs, each with the documents that it writes."""
    return markdown_table(("verb", "documents"), _documents("trunk", trunk))


def _documents(words: str, verb: click.Command) -> Iterator[tuple[str, str]]:
    for option in verb.params:
        if isinstance(option, JsonOption):
            yield f"`{words}`", ", ".join(f"`{kind.document}`" for kind in option.documents)
    if isinstance(verb, click.Group):
        context = click.Context(verb)
        for name in verb.list_commands(context):
            if below := verb.get_command(context, name):
                yield from _documents(f"{words} {name}", below)


def cart_pole() -> str:
    """Return the module of the cart-pole."""
    return f"```python\n{Path(module.__file__).read_text('utf-8')}```"


if __name__ == "__main__":
    for table in (parameters, files, documents, cart_pole):
        (Path(sys.argv[1]) / f"{table.__name__}.md").write_text(f"{table()}\n", encoding="utf-8")
