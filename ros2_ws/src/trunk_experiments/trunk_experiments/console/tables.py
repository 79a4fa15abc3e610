"""Tables as text, Markdown and CSV; no word of a text is broken, so that every name can be copied."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Iterable, Sequence
from shutil import get_terminal_size
from textwrap import wrap

import click
from rich.cells import cell_len

from trunk_core.text import printable

from .terminal import print_title

_SENTENCES = (
    32  # characters that a column of sentences needs; with less they are shown below their row
)
_EDGE = "  "  # before each row, and between columns
_BELOW = " " * 6  # before a sentence that stands below its row
_ENDLESS = 1 << 16  # columns where there is no terminal

Cells = Sequence[Sequence[str]]


def print_table(
    title: str,
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    texts: int = 1,
    sentences: bool = False,
) -> None:
    """Print a table: the first ``texts`` columns left-aligned, the others right; plain without a terminal.

    No word is broken. Without a terminal each row is one line. On a terminal that is too narrow for all
    columns, they are split into several tables, each beginning with the first column.
    ``sentences``: the last column holds sentences, shown below their row where there is no room beside it.
    """
    cells = [tuple(map(printable, row)) for row in (header, *rows)]
    width = screen_width()
    left = {*range(texts), *([len(header) - 1] if sentences else [])}
    print_title(title)
    if sentences and _least(cells, range(len(header) - 1)) + _SENTENCES > width:
        _print_with_sentences_below(cells, width)
        return
    columns = [0]
    for column in range(1, len(header)):
        if len(columns) > 1 and _least(cells, [*columns, column]) > width:
            _print_columns(cells, columns, left, width)
            columns = [0]
        columns.append(column)
    _print_columns(cells, columns, left, width)


def aligned(rows: Sequence[Sequence[str]], texts: int | None = None) -> list[str]:
    """Return rows as lines of any length: the first ``texts`` columns left-aligned, by default all."""
    widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
    left = len(widths) if texts is None else texts
    return [
        _EDGE.join(
            _padded(text, width, i < left)
            for i, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    lines = (header, ("---",) * len(header), *rows)
    escaped = ((cell.strip().replace("|", r"\|") for cell in line) for line in lines)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in escaped)


def csv_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV in full precision; a cell without a value is empty."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def screen_width() -> int:
    """Return the terminal's width; without a terminal a line may have any length."""
    return get_terminal_size().columns if sys.stdout.isatty() else _ENDLESS


def _least(cells: Cells, columns: Sequence[int]) -> int:
    """Return the width that columns need if all but the first wrap between words."""
    return sum(len(_EDGE) + _longest_word(cells, i) for i in columns)


def _longest_word(cells: Cells, column: int) -> int:
    texts = (row[column] for row in cells)
    if column == 0:
        return max(map(cell_len, texts))
    return max((cell_len(word) for text in texts for word in text.split()), default=0)


def _print_columns(cells: Cells, columns: Sequence[int], left: set[int], width: int) -> None:
    widths = [max(cell_len(row[i]) for row in cells) for i in columns]
    least = [_longest_word(cells, i) for i in columns]
    while (excess := sum(widths) + len(_EDGE) * len(widths) - width) > 0:
        gives = [w if w > lowest else 0 for w, lowest in zip(widths, least, strict=True)]
        if not any(gives):
            break
        widest = gives.index(max(gives))
        widths[widest] = max(least[widest], widths[widest] - excess)
    for number, row in enumerate(cells):
        wrapped = [
            [row[i]] if i == 0 else _wrapped(row[i], w)
            for i, w in zip(columns, widths, strict=True)
        ]
        for line in range(max(1, *map(len, wrapped))):
            texts = [lines[line] if line < len(lines) else "" for lines in wrapped]
            padded = [
                _padded(text, w, i in left)
                for text, w, i in zip(texts, widths, columns, strict=True)
            ]
            click.echo((_EDGE + _EDGE.join(padded)).rstrip())
        if number == 0:
            length = sum(widths) + len(_EDGE) * len(widths)
            click.echo(_EDGE + "-" * (min(length, width) - len(_EDGE)))
    click.echo()


def _padded(text: str, width: int, left: bool) -> str:
    space = " " * (width - cell_len(text))
    return text + space if left else space + text


def _print_with_sentences_below(cells: Cells, width: int) -> None:
    widths = [max(map(cell_len, column)) for column in zip(*cells, strict=True)][:-1]
    aligned = len(_EDGE) * len(widths) + sum(widths) <= width
    for number, (*values, sentence) in enumerate(cells):
        texts = [_padded(text, w, left=True) for text, w in zip(values, widths, strict=True)]
        line = _EDGE.join(texts if aligned else filter(None, values)).rstrip()
        for part in _wrapped(line, width, _EDGE, _BELOW):
            click.echo(part)
        if number == 0:
            click.echo(_EDGE + "-" * (width - len(_EDGE)))
            continue
        for part in _wrapped(sentence, width, _BELOW, _BELOW):
            click.echo(part)
    click.echo()


def _wrapped(text: str, width: int, first: str = "", then: str = "") -> list[str]:
    """Return a text as lines of whole words; ``first`` stands before the first, ``then`` before others."""
    return wrap(
        text,
        max(width, 1),  # a column may be empty
        initial_indent=first,
        subsequent_indent=then,
        break_long_words=False,
        break_on_hyphens=False,
    )
