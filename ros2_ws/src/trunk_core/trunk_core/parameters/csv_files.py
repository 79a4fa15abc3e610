"""Numbers over time in the CSV files that parameter files name, for a plan or a running node.

Each row is checked and in SI units; an error has its line.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..text import shortened
from .declarations import Declaration, ParameterError, UnitError, check, declarations, tables_of
from .parameter_files import Layer, ParameterFileError
from .to_si import read_quantity, units_of

MAX_BYTES = 4 * 1024**2
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
    headings = ",".join(column.heading for column in columns)
    wanted = f"a header {headings} is needed, then a row of numbers for each time"
    reader = csv.reader(StringIO(_text(path), newline=""), strict=True)
    table: list[list[float]] = [[] for _ in columns]
    units: list[str | None] = []
    try:
        for cells in reader:
            line = f"{path}: line {reader.line_num}"
            if units:
                _add_row(line, cells, columns, units, table)
            elif any(cell.strip() for cell in cells):
                units = _header(line, cells, columns, wanted)
    except csv.Error as error:
        raise ParameterFileError(
            f"{path}: line {reader.line_num}: not CSV: {error}: {wanted}"
        ) from None
    if not table[0]:
        raise ParameterFileError(f"{path}: it has no numbers: {wanted}")
    return CsvTable(tuple(map(tuple, table)), tuple(unit is not None for unit in units))


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
        raise ParameterFileError(f"{path}: not a text in UTF-8: save it as CSV UTF-8") from None


def _header(
    line: str, cells: Sequence[str], columns: Sequence[Column], wanted: str
) -> list[str | None]:
    """Return the units that the header gives, None where it gives none."""
    matches = [_HEADING.fullmatch(cell.strip()) for cell in cells]
    headings = [match.groups() if match else ("", None) for match in matches]
    if [name for name, _ in headings] != [column.name for column in columns]:
        raise ParameterFileError(f"{line}: {shortened(','.join(cells))!r} is not allowed: {wanted}")
    for column, (_, unit) in zip(columns, headings, strict=True):
        try:
            if unit is not None:
                read_quantity(f"1 {unit or 1}", column.unit)
        except UnitError as error:
            raise ParameterFileError(
                f"{line}: {column.name}: the unit {shortened(unit or '')!r} is not allowed: {error}"
            ) from None
    return [unit for _, unit in headings]


def _add_row(
    line: str,
    cells: Sequence[str],
    columns: Sequence[Column],
    units: Sequence[str | None],
    table: Sequence[list[float]],
) -> None:
    if not any(cell.strip() for cell in cells):
        return
    if len(cells) != len(columns):
        names = " and ".join(column.name for column in columns)
        raise ParameterFileError(
            f"{line}: {shortened(','.join(cells))!r} is not allowed: "
            f"{len(columns)} values are needed, {names}"
        )
    longest = columns[0].declaration.longest
    if len(table[0]) == longest:
        raise ParameterFileError(f"{line}: one row too many: at most {longest} are allowed")
    for column, unit, numbers, cell in zip(columns, units, table, cells, strict=True):
        try:
            numbers.append(_number(column, unit, cell.strip()))
        except UnitError as error:
            raise ParameterFileError(
                f"{line}: {column.name}: {shortened(cell.strip())!r} is not allowed: {error}"
            ) from None
    if table[0][-2:] != sorted(table[0][-2:]):
        raise ParameterFileError(
            f"{line}: {columns[0].name}: {shortened(cells[0])!r} is not allowed: "
            "times must ascend, and this one is before the time in the row above"
        )


def _number(column: Column, unit: str | None, text: str) -> float:
    if not _NUMBER.fullmatch(text):
        raise UnitError(
            f"a finite number is needed; its unit belongs in the header: {column.heading}"
        )
    number = float(text) if unit is None else read_quantity(f"{text} {unit}", column.unit)
    try:
        check(replace(column.declaration, kind="double", longest=None), number)
    except ParameterError as error:
        raise UnitError(f"{error.allowed}, in {column.unit}") from None
    return number


class Numbers(NamedTuple):
    """Values that a node's CSV files give, by parameter, and which of them were written with a unit."""

    values: dict[str, object]
    with_units: set[str]


class _Said(NamedTuple):
    value: object
    place: int  # a later one wins
    layer: Layer


def numbers_for(
    node: str,
    layers: Sequence[Layer],
    config: type[Any],
    present: Mapping[str, object] | None = None,
) -> Numbers:
    """Return the numbers of the CSV files that the layers name for a node (fully qualified name).

    ``present``: a running node's values of parameters that choose a unit, in place of the defaults.
    Raises ParameterFileError for a file that cannot be used, one whose profile does not count, and numbers
    given besides a file. What a later layer sets wins.
    """
    numbers = Numbers({}, set())
    sections = [(layer, section) for layer in layers for section in layer.sections]
    for table in tables_of(config):
        if not any(table.key.name in section.values for _, section in sections):
            continue
        said = {
            name: _Said(value, place, layer)
            for place, (layer, section) in enumerate(sections)
            if section.matches(node)
            for name, value in section.values.items()
        }
        file = said.get(table.key.name)
        if file is None or file.value == "":
            continue
        if not isinstance(file.value, str | PathLike):
            raise _refused(file, node, table.key.name, "a string is needed, the path of a CSV file")
        profile = said.get(f"{table.prefix}.profile")
        if table.profiles and (profile is None or profile.value not in table.profiles):
            if profile is not None and profile.place > file.place:
                continue  # a later layer overrides it
            allowed = f"{table.prefix}.profile: {' or '.join(table.profiles)}"
            raise _refused(file, node, table.key.name, f"it is used only with {allowed}")
        names = (f"{table.prefix}.times", f"{table.prefix}.values")
        for name in names:
            if name in said and said[name].place >= file.place:
                allowed = f"{table.key.name} gives the numbers: give only one of the two"
                raise _refused(said[name], node, name, allowed)
        declared = declarations(config)
        defaults = {name: declaration.default for name, declaration in declared.items()}
        given = {name: setting.value for name, setting in said.items()}
        chosen = {**defaults, **(present or {}), **given}
        columns = [
            Column(heading, declared[name], units_of(declared[name], chosen)[0][0])
            for heading, name in zip(("t", table.column), names, strict=True)
        ]
        try:
            read = read_csv(file.layer.folder / Path(file.value), columns)
        except ParameterFileError as error:
            source = f"{file.layer.source}: {_short(node)}: {table.key.name}"
            raise ParameterFileError(f"{source}: {error}") from None
        numbers.values.update(zip(names, read.columns, strict=True))
        numbers.with_units.update({names[1]} if read.with_unit[1] else ())
    return numbers


def _refused(setting: _Said, node: str, name: str, allowed: str) -> ParameterFileError:
    error = ParameterError(name, setting.value, allowed)
    return ParameterFileError(f"{setting.layer.source}: {_short(node)}: {error}")


def _short(node: str) -> str:
    return node.rpartition("/")[2]
