"""Plain values out of a YAML tree, each checked for its type; a mistake names file and place."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from trunk_msgs_util.parameters.declarations import UnitError, looks_like_quantity
from trunk_msgs_util.text import shortened

from ..errors import StudyError
from .study import Scalar
from .units import Units, number_of


class TreeReader:
    """Checks values; the place is kept for errors. All methods raise StudyError."""

    def __init__(self, source: str) -> None:
        self.source = source

    def error(self, place: str, message: str) -> StudyError:
        return StudyError(f"{self.source}: {place}: {message}")

    def mapping(self, value: object, place: str, known: tuple[str, ...] = ()) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.error(place, f"is {shown(value)}: a mapping is needed")
        for key in value:
            if known and key not in known:
                raise self.error(place, f"unknown key {key!r}: one of {', '.join(known)}")
        return value

    def text(self, value: object, place: str, choices: tuple[str, ...] = ()) -> str:
        if not isinstance(value, str) or (choices and value not in choices):
            raise self.error(place, f"is {shown(value)}: {', '.join(choices) or 'text'} is needed")
        return value

    def texts(self, value: object, place: str) -> tuple[str, ...]:
        items = [value] if isinstance(value, str) else value
        if not isinstance(items, list) or not all(isinstance(item, str) for item in items):
            raise self.error(place, f"is {shown(value)}: a list of strings is needed")
        return tuple(items)

    def number(self, value: object, place: str, units: Units = ()) -> float:
        if units and isinstance(value, str) and looks_like_quantity(value):
            try:
                value = number_of(value, units)
            except UnitError as error:
                raise self.error(place, f"is {shown(value)}: {error}") from None
        if isinstance(value, str) and re.fullmatch(r"[-+.\deE]+", value):
            try:
                return float(value)  # "1e-3" is a number to the user, but not to YAML 1.1
            except ValueError:
                pass
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise self.error(place, f"is {shown(value)}: a finite number is needed")
        return float(value)

    def integer(self, value: object, place: str, low: int, high: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(
                place, f"is {shown(value)}: a whole number from {low} to {high} is needed"
            )
        return value

    def optional(self, entries: Mapping[str, Any], key: str, unit: str) -> float | None:
        if key not in entries:
            return None
        value = self.number(entries[key], key, ((unit,),))
        if value <= 0.0:
            raise self.error(key, f"is {value:g}: a number > 0 is needed")
        return value

    def scalars(self, values: list[object], place: str, units: Units = ()) -> tuple[Scalar, ...]:
        scalars = tuple(self.scalar(value, place, units) for value in values)
        kinds = {type(value) if isinstance(value, bool | str) else float for value in scalars}
        if len(kinds) > 1:
            raise self.error(
                place, f"is {shown(values)}: all numbers, all strings or all bools are needed"
            )
        return scalars

    def scalar(self, value: object, place: str, units: Units) -> Scalar:
        if isinstance(value, bool | int):
            return value
        quantity = units and isinstance(value, str) and looks_like_quantity(value)
        plain = r"[-+]?[\d.]+[eE][-+]?\d+"
        if isinstance(value, str) and not quantity and not re.fullmatch(plain, value):
            return value
        return self.number(value, place, units)


def shown(value: object) -> str:
    """Return a value as an error quotes it."""
    return shortened(repr(value), 60)
