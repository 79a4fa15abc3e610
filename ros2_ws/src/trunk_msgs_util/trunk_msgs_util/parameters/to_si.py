"""Converts values as a user writes them to plain values in their declared SI unit. Pure.

A plain number is in the declared SI unit already; a text parameter is never read as a quantity.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from .declarations import Declaration, ParameterError, UnitError, Value, looks_like_quantity


def to_si(
    declared: Mapping[str, Declaration],
    values: Mapping[str, object],
    present: Mapping[str, object] | None = None,
) -> dict[str, object]:
    """Return a node's values, each number that has a unit converted to the declared SI unit.

    ``present``: a running node's values of parameters that choose a unit, in place of the defaults.
    Raises ParameterError for a unit that does not exist, or of another dimension. Everything else is
    returned as it is, for `declarations.build` to check.
    """
    written = written_with_units(declared, values)
    if not written:
        return dict(values)
    defaults = {name: declaration.default for name, declaration in declared.items()}
    complete = {**defaults, **(present or {}), **values}
    converted = dict(values)
    for name in written:
        declaration = declared[_whole(name)]
        units = units_of(declaration, complete)
        index = name.removesuffix("]").partition("[")[2]
        if index.isdecimal():
            units = (units[min(int(index), len(units) - 1)],)
        converted[name] = _converted(declaration, values[name], units)
    return converted


def written_with_units(
    declared: Mapping[str, Declaration], values: Mapping[str, object]
) -> set[str]:
    """Return the names of the numeric parameters whose values are written with a unit."""
    return {
        name
        for name, value in values.items()
        if _whole(name) in declared
        and any(map(_is_quantity, _numbers_in(declared[_whole(name)], name, value)))
    }


def _whole(name: str) -> str:
    """Return the parameter itself where an element is named, ARRAY[INDEX]."""
    return name.partition("[")[0] if name.endswith("]") else name


def _numbers_in(declaration: Declaration, name: str, value: object) -> Sequence[object]:
    """Return the items that may be numbers with a unit: integers have none, texts are texts."""
    if declaration.kind == "double array" and isinstance(value, list | tuple):
        return value
    element = declaration.kind == "double array" and name.endswith("]")
    return (value,) if declaration.kind == "double" or element else ()


def _is_quantity(item: object) -> bool:
    return isinstance(item, str) and looks_like_quantity(item)


def units_of(
    declaration: Declaration, values: Mapping[str, object] | None = None
) -> tuple[tuple[str, ...], ...]:
    """Return the units that each element may have, the last ones for all further elements.

    ``values``: the node's; without them, or if they do not say which unit counts, each of
    ``declaration.units`` may be meant.
    """
    if declaration.unit_by:
        chosen = (values or {}).get(declaration.unit_by)
        meant = tuple(unit for value, unit in declaration.units if value == chosen)
        return (meant or tuple(unit for _, unit in declaration.units),)
    if declaration.length is not None:
        return tuple((unit,) for unit in declaration.unit.split(", "))
    return ((declaration.unit,),)


def number_in(text: str | float, unit: str) -> float:
    """Return a number in a unit, given as a number, its text, or a text with a unit.

    Raises UnitError.
    """
    try:
        return float(text)
    except ValueError:
        return read_quantity(str(text), unit)


def read_quantity(text: str, *units: str) -> float:
    """Return `quantity.read_quantity`'s number; that module is loaded for the first one."""
    from . import quantity

    return quantity.read_quantity(text, *units)


def _converted(declaration: Declaration, value: object, units: Sequence[Sequence[str]]) -> object:
    def convert(item: object, place: int | None = None) -> object:
        if not isinstance(item, str) or not looks_like_quantity(item):
            return item
        try:
            return read_quantity(item, *units[min(place or 0, len(units) - 1)])
        except UnitError as error:
            element = "" if place is None else f"element {place}: "
            chooser = f" ({declaration.unit_by} chooses the unit)" if declaration.unit_by else ""
            raise ParameterError(declaration.name, item, f"{element}{error}{chooser}") from None

    if isinstance(value, list | tuple):
        return [convert(item, place) for place, item in enumerate(value)]
    return convert(value)


_NUMBER = re.compile(r"[-+]?(inf|\d+(\.\d*)?(e[-+]?\d+)?)", re.ASCII)


def meant(declaration: Declaration, value: object, present: Value) -> object:
    """Return the meaning of a value that ``ros2 param load`` sends; ``present``: the current value.

    It sends a value as YAML reads the value's Python text: ``.inf`` in the file arrives as the text ``inf``,
    ``1.0e-05`` as ``1e-05`` and ``[.inf, 0.5]`` as ``[inf, 0.5]``; the text ``"1.5"`` arrives as a number.

    A number's text is the number where a double is declared. For a declared string, a value of another
    type is the present text if YAML reads that text so. Everything else is returned as it is, to be
    checked or refused as it was sent.
    """
    if declaration.kind == "double" and isinstance(value, str):
        return _number(value)
    if declaration.kind == "double array":
        return _numbers(value)
    if declaration.kind == "string" and isinstance(value, bool | int | float):
        return present if _reads_as(present, value) else value
    return value


def _number(item: object) -> object:
    if isinstance(item, str) and _NUMBER.fullmatch(item):
        return float(item)
    return item


def _numbers(value: object) -> object:
    if isinstance(value, str) and value.startswith("[") and value.endswith("]"):
        items = [_number(item.strip()) for item in value[1:-1].split(",")]
    elif isinstance(value, list):
        items = [_number(item) for item in value]
    else:
        return value
    return value if any(isinstance(item, str) for item in items) else items


def _reads_as(text: Value, value: object) -> bool:
    import yaml  # slow to import, and needed by running nodes alone

    try:
        read = yaml.safe_load(str(text))
    except (yaml.YAMLError, ValueError):
        return False
    return type(read) is type(value) and repr(read) == repr(value)
