"""How results are shown: rows as text for a terminal, as a table for a notebook; read-only mappings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from types import MappingProxyType
from typing import TypeVar

from trunk_msgs_util.text import printable

Inner = TypeVar("Inner")


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in HTML, every text escaped: a recording's words are not markup."""

    def line(tag: str, cells: Sequence[object]) -> str:
        aligned = ("left", *("right" for _ in cells[1:])) if len(cells) > 2 else ("left", "left")
        return "".join(
            f'<{tag} style="text-align: {side}">{escape(printable(str(cell)))}</{tag}>'
            for cell, side in zip(cells, aligned, strict=False)
        )

    head = f"<thead><tr>{line('th', header)}</tr></thead>" if any(header) else ""
    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    caption = f'<caption style="text-align: left"><b>{escape(printable(title))}</b></caption>'
    return f"<table>{caption}{head}<tbody>{body}</tbody></table>"


def text_table(rows: Iterable[Sequence[str]]) -> str:
    """Return rows as text in columns: the first left, the second right, the rest left."""
    cells = [[printable(cell) for cell in row] for row in rows]
    first, second = (max((len(row[i]) for row in cells), default=0) for i in (0, 1))
    return "\n".join(
        f"{row[0]:{first}}  {row[1]:>{second}}  {' '.join(row[2:])}".rstrip() for row in cells
    )


def keyed(nested: Mapping[str, Mapping[str, Inner]]) -> Mapping[str, Mapping[str, Inner]]:
    """Return nested mappings that cannot be changed."""
    return MappingProxyType({key: MappingProxyType(dict(inner)) for key, inner in nested.items()})
