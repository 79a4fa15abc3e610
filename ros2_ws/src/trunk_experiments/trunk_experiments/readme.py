"""Generated parts of README.md and docs/*.md; ``scripts/update_readme.sh`` inserts them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event

from . import api
from .api._reference import reference
from .commands.params import markdown
from .plans.files import shipped_files
from .plans.nodes import NODES

_SECTION = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def topics_table() -> str:
    """Return the topics as a Markdown table."""
    lines = ["| topic | type | from | content |", "|---|---|---|---|"]
    lines += [
        f"| `{name}` | {kind.replace('/msg/', '/')} | {publisher} | {content} |"
        for name, kind, publisher, content in topics.DESCRIPTIONS
    ]
    return "\n".join(lines)


def events_table() -> str:
    """Return the events of ``run/events`` as a Markdown table."""
    lines = ["| event | sent by | values | meaning |", "|---|---|---|---|"]
    lines += [
        f"| {event} | {event.said_by} | {', '.join(event.carries)} | {event.meaning} |"
        for event in Event
    ]
    return "\n".join(lines)


def parameters_tables() -> str:
    """Return every node's parameters, a folded Markdown table each."""
    return "\n\n".join(
        f"<details><summary><b>{node}</b> (package {kind.package})</summary>\n\n"
        f"{markdown(node)}\n\n</details>"
        for node, kind in NODES.items()
    )


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
    "topics": topics_table,
    "events": events_table,
    "parameters": parameters_tables,
    "files": files_table,
}


def refreshed(text: str) -> str:
    """Return a page's text with its generated sections regenerated."""
    return _SECTION.sub(lambda m: f"{m[1]}{_SECTIONS[m[2]]()}\n{m[3]}", text)


if __name__ == "__main__":
    for page in map(Path, sys.argv[1:]):
        page.write_text(refreshed(page.read_text(encoding="utf-8")), encoding="utf-8")
