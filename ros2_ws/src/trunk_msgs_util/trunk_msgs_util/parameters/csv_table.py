"""Numbers over time in a CSV file: each row checked, in SI units, an error with its line."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from .declarations import Declaration, ParameterError, check
from .files import ParameterFileError
from .in_si import read_quantity
from .quantity_text import UnitError

MAX_BYTES = 4 * 1024**2
_SHOWN = 40  # characters quoted in an error
_HEADING = re.compile(r"([^\[\]]*?)\s*(?:\[([^\[\]]*)\])?", re.DOTALL)
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


class Column(NamedTuple):
    """A column: its name, what declares its numbers (an array), and their SI unit."""

    name: str
    declaration: Declaration
    unit: str

    @property
    def heading(self) -> str:
        """How the header names it: ``t [s]``."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


class CsvTable(NamedTuple):
    """The numbers of each column in SI units, and whether the header gave it a unit."""

    columns: tuple[tuple[float, ...], ...]
    with_unit: tuple[bool, ...]


def read_csv(path: Path, columns: Sequence[Column]) -> CsvTable:
    """Return the numbers of a CSV file that has exactly these columns; those of the first one ascend.

    The header may give another unit of the same kind in brackets: ``t [ms],reference [deg]``. A column
    without brackets is in SI units. Numbers are finite, within their declaration's bounds, and at most
    as many as it allows; equal times in two rows are allowed. Blank lines are skipped.
    Raises ParameterFileError: file, line, value, what is allowed.
    """
    reader = csv.reader(StringIO(_text(path), newline=""), strict=True)
    try:
        return _read(path, reader, columns)
    except csv.Error as error:
        raise ParameterFileError(
            f"{path}: line {reader.line_num}: not CSV: {error}: {_wanted(columns)}"
        ) from None


def _read(path: Path, reader: Iterator[list[str]], columns: Sequence[Column]) -> CsvTable:
    found: list[list[float]] = [[] for _ in columns]
    units: list[str | None] | None = None
    longest = columns[0].declaration.longest
    for cells in reader:
        line = f"{path}: line {reader.line_num}"  # type: ignore[attr-defined]
        if not any(cell.strip() for cell in cells):
            continue
        if units is None:
            units = _header(line, cells, columns)
            continue
        if len(cells) != len(columns):
            names = " and ".join(column.name for column in columns)
            raise ParameterFileError(
                f"{line}: {_quoted(','.join(cells))} is not allowed: "
                f"{len(columns)} values are needed, {names}"
            )
        if len(found[0]) == longest:
            raise ParameterFileError(f"{line}: one row too many: at most {longest} are allowed")
        for column, unit, numbers, cell in zip(columns, units, found, cells, strict=True):
            numbers.append(_number(line, column, unit, cell))
        if found[0][-2:] != sorted(found[0][-2:]):
            raise ParameterFileError(
                f"{line}: {columns[0].name}: {_quoted(cells[0])} is not allowed: "
                "times must ascend, and this one is before the time in the row above"
            )
    if units is None or not found[0]:
        raise ParameterFileError(f"{path}: it has no numbers: {_wanted(columns)}")
    return CsvTable(tuple(map(tuple, found)), tuple(unit is not None for unit in units))


def _text(path: Path) -> str:
    try:
        if not path.is_file():
            raise ParameterFileError(f"{path}: no such file: give a CSV file's path")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ParameterFileError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_BYTES:
        raise ParameterFileError(
            f"{path}: larger than {MAX_BYTES // 1024**2} MiB: give a smaller file"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ParameterFileError(f"{path}: not a text file: give a CSV file") from None


def _header(line: str, cells: Sequence[str], columns: Sequence[Column]) -> list[str | None]:
    """Return the units that the header gives, None where it gives none."""
    headings = [_HEADING.fullmatch(cell.strip()) for cell in cells]
    names = [None if heading is None else heading[1] for heading in headings]
    if names != [column.name for column in columns]:
        raise ParameterFileError(
            f"{line}: {_quoted(','.join(cells))} is not allowed: {_wanted(columns)}"
        )
    units: list[str | None] = []
    for heading, column in zip(headings, columns, strict=True):
        assert heading is not None
        unit = None if heading[2] is None else heading[2].strip()
        if unit is not None:
            try:
                read_quantity(f"1 {unit or 1}", column.unit)
            except UnitError as error:
                raise ParameterFileError(
                    f"{line}: {column.name}: the unit {_quoted(unit)} is not allowed: {error}"
                ) from None
        units.append(unit)
    return units


def _number(line: str, column: Column, unit: str | None, cell: str) -> float:
    text = cell.strip()
    problem = f"{line}: {column.name}: {_quoted(text)} is not allowed"
    if not _NUMBER.fullmatch(text):
        raise ParameterFileError(
            f"{problem}: a finite number is needed; its unit belongs in the header: {column.heading}"
        )
    try:
        number = float(text) if unit is None else read_quantity(f"{text} {unit}", column.unit)
        check(replace(column.declaration, kind="double", longest=None), number)
    except UnitError as error:
        raise ParameterFileError(f"{problem}: {error}") from None
    except ParameterError as error:
        raise ParameterFileError(f"{problem}: {error.allowed}, in {column.unit}") from None
    return number


def _wanted(columns: Sequence[Column]) -> str:
    headings = ",".join(column.heading for column in columns)
    return f"a header {headings} is needed, then a row of numbers for each time"


def _quoted(text: str) -> str:
    return repr(text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "...")
