"""Checks of what a law declares."""

from __future__ import annotations

from collections.abc import Iterator

from trunk_control.controller_config import ControllerConfig
from trunk_control.law import Law
from trunk_msgs_util.parameters.declarations import declarations

from .finding import LawFinding, name_of, numbers_in


def bounded(law: Law) -> Iterator[LawFinding]:
    """Yield parameters without a description, bounds or a unit."""
    shared = set(declarations(ControllerConfig))
    for name, declared in declarations(law.config).items():
        if name in shared:
            continue
        where = f"{name_of(law.config)} {name}"
        if not declared.description.strip():
            yield LawFinding("declared", where, "has no description", "say in a phrase what it is")
        if isinstance(declared.default, str | bool | tuple) and not isinstance(
            next(iter(numbers_in(declared.default)), None), float
        ):
            continue
        limited_below = declared.minimum is not None or declared.above is not None
        if not declared.unbounded and not (limited_below and declared.maximum is not None):
            yield LawFinding(
                "declared", where, "has no bounds", "give minimum or above, and maximum"
            )
        if not declared.unit and isinstance(declared.default, float):
            yield LawFinding(
                "declared",
                where,
                "has no unit",
                "give unit=..., in SI; none for a ratio",
                note=True,
            )


def named(law: Law) -> Iterator[LawFinding]:
    """Yield names of terms that hide what every record has, and terms without a unit."""
    for name in law.terms._fields:
        if name in ("reference", "measurement"):
            yield LawFinding(
                "names",
                name_of(law.terms),
                f"has a field {name!r}, which every record already has",
                "leave it out or rename it",
            )
    missing = [name for name in law.terms._fields[:-3] if name not in law.units]
    if missing:
        yield LawFinding(
            "names",
            name_of(law.terms),
            f"{', '.join(missing)}: without a unit",
            "give it in Law(units=...), an empty one for a ratio",
            note=True,
        )
