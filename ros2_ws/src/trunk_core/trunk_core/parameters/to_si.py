"""Converts values as a user writes them to plain values in their declared SI unit. Pure.

A plain number is in the declared SI unit already; a text parameter is never read as a quantity.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ..text import plain_number
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
    converted = dict(values)
    for name in written_with_units(declared, values):
        whole, index = _parts(name)
        defaults = {known: declaration.default for known, declaration in declared.items()}
        units = units_of(declared[whole], {**defaults, **(present or {}), **values})
        value = values[name]
        items = value if isinstance(value, list | tuple) else [value]
        first = int(index) if index.isdecimal() else 0
        numbers = [
            _converted(declared[whole], item, place, units[min(place, len(units) - 1)])
            for place, item in enumerate(items, first)
        ]
        converted[name] = numbers if items is value else numbers[0]
    return converted


def written_with_units(
    declared: Mapping[str, Declaration], values: Mapping[str, object]
) -> set[str]:
    """Return the names of the numeric parameters whose values are written with a unit.

    Integers have none, texts are texts.
    """
    written = set()
    for name, value in values.items():
        whole, index = _parts(name)
        items = value if isinstance(value, list | tuple) else [value]
        kind = "double array" if items is value or index else "double"
        if whole in declared and declared[whole].kind == kind:
            written |= {name} if any(map(looks_like_quantity, items)) else set()
    return written


def _parts(name: str) -> tuple[str, str]:
    """Return a parameter's name, and the index if an element is named, ARRAY[INDEX]."""
    whole, _, index = name.removesuffix("]").partition("[")
    return whole, index


def _converted(declaration: Declaration, item: object, place: int, units: Sequence[str]) -> object:
    if not looks_like_quantity(item):
        return item
    try:
        return read_quantity(str(item), *units)
    except UnitError as error:
        element = f"element {place}: " if declaration.kind == "double array" else ""
        chooser = f" ({declaration.unit_by} chooses the unit)" if declaration.unit_by else ""
        raise ParameterError(declaration.name, item, f"{element}{error}{chooser}") from None


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
        return plain_number(text) if isinstance(text, str) else float(text)
    except ValueError:
        return read_quantity(str(text), unit)


def read_quantity(text: str, *units: str) -> float:
    """Return `quantity.read_quantity`'s number; that module is loaded for the first one."""
    from . import quantity

    return quantity.read_quantity(text, *units)


_NUMBER = re.compile(r"[-+]?(inf|\d+(\.\d*)?(e[-+]?\d+)?)", re.ASCII)


def meant(declaration: Declaration, value: object, present: Value) -> object:
    """Return the meaning of a value that ``ros2 param load`` sends; ``present``: the current value.

    It sends a value as YAML reads the value's Python text: ``.inf`` in the file arrives as the text ``inf``,
    ``1.0e-05`` as ``1e-05`` and ``[.inf, 0.5]`` as ``[inf, 0.5]``; the text ``"1.5"`` arrives as a number.

    A number's text is the number where a double is declared. For a declared string, a value of another
    type is the present text if YAML reads that text so. Everything else is returned as it is, to be
    checked or refused as it was sent.
    """
    if declaration.kind == "double":
        return _number(value)
    if declaration.kind == "double array":
        text = re.fullmatch(r"\[(.*)\]", value) if isinstance(value, str) else None
        items = text[1].split(",") if text else value if isinstance(value, list) else []
        numbers = [_number(item) for item in items]
        return value if any(isinstance(number, str) for number in numbers) else numbers or value
    if declaration.kind == "string" and isinstance(value, bool | int | float):
        return present if _reads_as(present, value) else value
    return value


def _number(item: object) -> object:
    return float(item) if isinstance(item, str) and _NUMBER.fullmatch(item.strip()) else item


def _reads_as(text: Value, value: object) -> bool:
    import yaml  # slow to import, and needed by running nodes alone

    try:
        read = yaml.safe_load(str(text))
    except (yaml.YAMLError, ValueError):
        return False
    return type(read) is type(value) and repr(read) == repr(value)
