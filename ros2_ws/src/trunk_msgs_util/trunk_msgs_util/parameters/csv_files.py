"""Numbers over time in the CSV files that parameter files name, for a plan or a running node.

Each row is checked and in SI units; an error has its line.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..text import shortened
from .csv_parameters import FILE, TableFile, tables_of
from .declarations import Declaration, ParameterError, UnitError, check, declarations
from .files import Layer, ParameterFileError
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
    reader = csv.reader(StringIO(_text(path), newline=""), strict=True)
    try:
        return _read(path, reader, columns)
    except csv.Error as error:
        raise ParameterFileError(
            f"{path}: line {reader.line_num}: not CSV: {error}: {_wanted(columns)}"
        ) from None


def _read(path: Path, reader: Iterator[list[str]], columns: Sequence[Column]) -> CsvTable:
    table: list[list[float]] = [[] for _ in columns]
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
                f"{line}: {shortened(','.join(cells))!r} is not allowed: "
                f"{len(columns)} values are needed, {names}"
            )
        if len(table[0]) == longest:
            raise ParameterFileError(f"{line}: one row too many: at most {longest} are allowed")
        for column, unit, numbers, cell in zip(columns, units, table, cells, strict=True):
            numbers.append(_number(line, column, unit, cell))
        if table[0][-2:] != sorted(table[0][-2:]):
            raise ParameterFileError(
                f"{line}: {columns[0].name}: {shortened(cells[0])!r} is not allowed: "
                "times must ascend, and this one is before the time in the row above"
            )
    if units is None or not table[0]:
        raise ParameterFileError(f"{path}: it has no numbers: {_wanted(columns)}")
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


def _header(line: str, cells: Sequence[str], columns: Sequence[Column]) -> list[str | None]:
    """Return the units that the header gives, None where it gives none."""
    headings = [_HEADING.fullmatch(cell.strip()) for cell in cells]
    names = [None if heading is None else heading[1] for heading in headings]
    if names != [column.name for column in columns]:
        raise ParameterFileError(
            f"{line}: {shortened(','.join(cells))!r} is not allowed: {_wanted(columns)}"
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
                    f"{line}: {column.name}: the unit {shortened(unit)!r} is not allowed: {error}"
                ) from None
        units.append(unit)
    return units


def _number(line: str, column: Column, unit: str | None, cell: str) -> float:
    text = cell.strip()
    problem = f"{line}: {column.name}: {shortened(text)!r} is not allowed"
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
    Raises ParameterFileError for a file that cannot be used, keys whose switch is not "file" or the
    reverse, and numbers given besides a file. What a later layer sets wins.
    """
    numbers = Numbers({}, set())
    said: dict[str, _Said] | None = None
    for table in tables_of(config):
        names = {key.name for key in table.keys} | ({table.switch} - {""})
        if not any(names & s.values.keys() for layer in layers for s in layer.sections):
            continue
        said = _said(node, layers) if said is None else said
        if _counts(table, said, node):
            _fill(numbers, table, said, node, config, present or {})
    return numbers


def _said(node: str, layers: Sequence[Layer]) -> dict[str, _Said]:
    sections = [(layer, section) for layer in layers for section in layer.sections]
    return {
        name: _Said(value, place, layer)
        for place, (layer, section) in enumerate(sections)
        if section.matches(node)
        for name, value in section.values.items()
    }


def _counts(table: TableFile, said: Mapping[str, _Said], node: str) -> bool:
    """Return True if a file is named and is to be used."""
    key = said.get(table.key.name)
    named = key is not None and key.value != ""
    switch = said.get(table.switch)
    if not table.switch:
        return named
    if switch is not None and switch.value == FILE:
        if not named:
            raise _refused(
                switch, node, table.switch, f"with it, {table.key.name} must name a CSV file"
            )
        return True
    for name in (setting.name for setting in table.keys):
        setting = said.get(name)
        if setting is None or setting.value == "":
            continue
        if switch is None or switch.place <= setting.place:  # else a later layer overrides it
            raise _refused(setting, node, name, f"it is used only with {table.switch}: {FILE}")
    return False


def _fill(
    numbers: Numbers,
    table: TableFile,
    said: Mapping[str, _Said],
    node: str,
    config: type[Any],
    present: Mapping[str, object],
) -> None:
    key, name = said[table.key.name], table.key.name
    if not isinstance(key.value, str | PathLike):
        raise _refused(key, node, name, "a string is needed, the path of a CSV file")
    for other in (table.times, table.values):
        if other in said and said[other].place >= key.place:
            raise _refused(
                said[other], node, other, f"{name} gives the numbers: give only one of the two"
            )
    declared = declarations(config)
    defaults = {setting.name: setting.default for setting in declared.values()}
    chosen = {**defaults, **present, **{name: setting.value for name, setting in said.items()}}
    columns = [
        Column(heading, declared[target], units_of(declared[target], chosen)[0][0])
        for heading, target in (("t", table.times), (table.column, table.values))
    ]
    try:
        (times, values), with_unit = read_csv(key.layer.folder / Path(key.value), columns)
    except ParameterFileError as error:
        raise ParameterFileError(f"{key.layer.source}: {_short(node)}: {name}: {error}") from None
    numbers.values.update({table.times: times, table.values: values})
    numbers.with_units.update({table.values} if with_unit[1] else ())
    if table.interpolation is not None:
        how = said.get(table.interpolation.name)
        kind = table.interpolation.default if how is None else how.value
        try:
            numbers.values[table.switch] = dict(table.becomes)[
                str(check(table.interpolation, kind))
            ]
        except ParameterError as error:
            assert how is not None
            raise ParameterFileError(f"{how.layer.source}: {_short(node)}: {error}") from None


def _refused(setting: _Said, node: str, name: str, allowed: str) -> ParameterFileError:
    error = ParameterError(name, setting.value, allowed)
    return ParameterFileError(f"{setting.layer.source}: {_short(node)}: {error}")


def _short(node: str) -> str:
    return node.rpartition("/")[2]
