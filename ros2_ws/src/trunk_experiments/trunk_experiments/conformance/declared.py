"""Checks of what a law declares."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from trunk_control.controller_config import ControllerConfig
from trunk_control.law import Law
from trunk_msgs_util.parameters.csv_parameters import listed
from trunk_msgs_util.parameters.declarations import Declaration, declarations, table_of
from trunk_msgs_util.parameters.files import ParameterFileError, read

from .finding import LawFinding, name_of, numbers_in


def bounded(law: Law) -> Iterator[LawFinding]:
    """Yield parameters without a description, bounds or a unit."""
    for name, declared in _own(law).items():
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


def in_default_file(law: Law) -> Iterator[LawFinding]:
    """Yield differences in parameters between the law and the package's ``config/default.yaml``."""
    package = sys.modules[law.config.__module__.partition(".")[0]]
    path = Path(package.__file__ or "").parent / "config" / "default.yaml"
    if not path.is_file():
        return
    try:
        layer = read(path)
    except ParameterFileError as error:
        yield LawFinding("defaults", str(path), str(error), "correct the file, or delete it")
        return
    sections = [section for section in layer.sections if section.last_token == law.name]
    if not sections:
        return
    given = {name: value for section in sections for name, value in section.values.items()}
    known = listed(law.config)
    covered = {table_of(name, known) or name for name in given}
    for name in given:
        if name not in known and not table_of(name, known):
            advice = f"rename or remove it: the law has {', '.join(_own(law)) or 'none of its own'}"
            yield LawFinding(
                "defaults", str(path), f"sets {name}, which the law does not declare", advice
            )
    for name, declared in _own(law).items():
        where = f"{name}, default {declared.default}"
        if name not in covered:
            yield LawFinding("defaults", str(path), f"lacks {where}", "add it, or delete the file")
        elif isinstance(given.get(name), int | float) and given[name] != declared.default:
            problem = f"has {name}: {given[name]}, the law's default is {declared.default}"
            yield LawFinding(
                "defaults", str(path), problem, "write the law's value, if that is meant", note=True
            )


def _own(law: Law) -> dict[str, Declaration]:
    shared = declarations(ControllerConfig)
    return {name: d for name, d in declarations(law.config).items() if name not in shared}
