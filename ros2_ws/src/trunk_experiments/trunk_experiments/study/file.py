"""A study's file: strictly checked YAML, each mistake one line. docs/sweep.md describes it."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from trunk_msgs_util.yaml_text import YamlTextError, load

from ..errors import DrawError, StudyError, did_you_mean
from ..plans.nodes import CONTROLLERS
from .draws import DISTRIBUTIONS, Distribution
from .study import (
    HOWS,
    MAX_RUNS,
    RESERVED,
    SPACINGS,
    ContenderSpec,
    Scalar,
    StudySpec,
    Target,
    Variable,
)
from .tree import TreeReader, shown
from .units import Units, units_for, written_in


def shipped_studies() -> dict[str, Path]:
    """Return the shipped studies by bare name."""
    folder = Path(str(files("trunk_experiments"))) / "studies"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def read_study(name: str) -> StudySpec:
    """Return the study of a file, by path or shipped name. Raises StudyError."""
    shipped = shipped_studies()
    path = shipped.get(name, Path(name))
    if not path.is_file():
        raise StudyError(
            f"no study {name!r}: there is no such file: give one, or one of {', '.join(shipped)}"
            f"{did_you_mean(name, shipped)}"
        )
    try:
        return parse_study(path.read_text(encoding="utf-8"), str(path))
    except UnicodeDecodeError:
        raise StudyError(f"{path}: not a text file; give a study in YAML") from None


def parse_study(text: str, source: str) -> StudySpec:
    """Return the study in a file's text. Raises StudyError naming the source, the place, what is allowed."""
    try:
        tree = load(text)
    except YamlTextError as error:
        raise StudyError(f"{source}: {error}") from None
    return _Reader(source).study(tree, text)


class _Reader(TreeReader):
    """Turns a YAML tree into a study."""

    def study(self, tree: object, text: str) -> StudySpec:
        known = ("scenario", "controllers", "params", "set", "rate", "duration")
        entries = self.mapping(tree, "the file", (*known, "runs", "seed", "block", "vary"))
        for key in ("scenario", "controllers", "vary"):
            if key not in entries:
                raise self.error(key, "missing: every study needs it")
        contenders = self.contenders(entries["controllers"])
        study = StudySpec(
            source=self.source,
            text=text,
            scenario=self.text(entries["scenario"], "scenario"),
            contenders=contenders,
            variables=tuple(
                self.variable(str(name), entry, contenders)
                for name, entry in self.mapping(entries["vary"], "vary").items()
            ),
            params=self.texts(entries.get("params", []), "params"),
            settings=self.settings(entries.get("set", {}), "set"),
            rate=self.optional(entries, "rate", "Hz"),
            duration=self.optional(entries, "duration", "s"),
            runs=self.integer(entries.get("runs", 1), "runs", 1, 10_000_000),
            seed=self.integer(entries.get("seed", 1), "seed", 0, 2**31 - 1),
            block=self.integer(entries.get("block", StudySpec.block), "block", 1, 100_000),
        )
        if study.total > MAX_RUNS:
            raise self.error("vary", f"{study.total} runs in all: at most {MAX_RUNS} are allowed")
        return study

    def settings(self, value: object, place: str) -> tuple[str, ...]:
        entries = self.mapping(value, place)
        return tuple(
            f"{name}={yaml.safe_dump(v, default_flow_style=True).removesuffix('...' + chr(10)).strip()}"
            for name, v in entries.items()
        )

    def contenders(self, value: object) -> tuple[ContenderSpec, ...]:
        entries = dict.fromkeys(value) if isinstance(value, list) else value
        by_label = self.mapping(entries, "controllers")
        if not by_label:
            raise self.error("controllers", f"is empty: name some of {', '.join(CONTROLLERS)}")
        contenders = []
        for label, entry in by_label.items():
            place = f"controllers.{label}"
            options = self.mapping(entry or {}, place, ("node", "params", "set"))
            contenders.append(
                ContenderSpec(
                    str(label),
                    self.text(options.get("node", label), place, CONTROLLERS),
                    self.texts(options.get("params", []), f"{place}.params"),
                    self.settings(options.get("set", {}), f"{place}.set"),
                )
            )
        return tuple(contenders)

    def variable(self, name: str, entry: object, contenders: tuple[ContenderSpec, ...]) -> Variable:
        place = f"vary.{name}"
        if not re.fullmatch(r"[A-Za-z]\w*", name) or name in RESERVED:
            raise self.error(
                place,
                f"is not a column name: letters, digits, _, and none of {', '.join(RESERVED)}",
            )
        if not isinstance(entry, dict) or "parameter" not in entry:
            raise self.error(place, "needs a parameter: NODE.PARAM, or a list of them")
        targets = tuple(self.target(t, place) for t in self.texts(entry["parameter"], place))
        how = self.text(entry.get("as", "value"), f"{place}.as", HOWS)
        rest = {key: value for key, value in entry.items() if key not in ("parameter", "as")}
        units = units_for(targets, how, contenders)
        written = written_in(rest) if units else ()
        if "distribution" in rest:
            drawn = self.distribution(rest, place, units)
            return Variable(name, targets, how, distribution=drawn, written=written)
        return Variable(name, targets, how, self.values(rest, place, units), written=written)

    def target(self, text: str, place: str) -> Target:
        nodes = ("simulator", "disturbance", "controller", *CONTROLLERS)
        match = re.fullmatch(r"(\w+)\.([\w.]+?)(?:\[(\d+)\])?", text)
        if match is None or match[1] not in nodes:
            raise self.error(
                place,
                f"parameter {text!r}: NODE.PARAM or NODE.PARAM[INDEX] is needed, NODE one of "
                f"{', '.join(nodes)}",
            )
        return Target(match[1], match[2], None if match[3] is None else int(match[3]))

    def values(self, entry: dict[str, Any], place: str, units: Units) -> tuple[Scalar, ...]:
        if "values" in entry:
            self.mapping(entry, place, ("values",))
            values = entry["values"]
            if not isinstance(values, list) or not values:
                raise self.error(f"{place}.values", f"is {shown(values)}: a list is needed")
            return self.scalars(values, f"{place}.values", units)
        self.mapping(entry, place, ("values", "distribution", "from", "to", "steps", "spacing"))
        for key in ("from", "to", "steps"):
            if key not in entry:
                raise self.error(place, "needs values, or from, to and steps, or a distribution")
        low, high = (self.number(entry[key], f"{place}.{key}", units) for key in ("from", "to"))
        steps = self.integer(entry["steps"], f"{place}.steps", 1, 1_000_000)
        if self.text(entry.get("spacing", "linear"), f"{place}.spacing", SPACINGS) == "linear":
            return tuple(np.linspace(low, high, steps).tolist())
        if low <= 0.0 or high <= 0.0:
            raise self.error(place, f"spacing log from {low:g} to {high:g}: both must be > 0")
        return tuple(np.geomspace(low, high, steps).tolist())

    def distribution(self, entry: dict[str, Any], place: str, units: Units) -> Distribution:
        kind = self.text(
            entry["distribution"], f"{place}.distribution", tuple(sorted(DISTRIBUTIONS))
        )
        needed, optional = DISTRIBUTIONS[kind]
        self.mapping(entry, place, ("distribution", *needed, *optional))
        for key in needed:
            if key not in entry:
                raise self.error(place, f"distribution {kind}: {key} is missing")
        choices = entry.get("values", [])
        if not isinstance(choices, list) or ("values" in needed and not choices):
            raise self.error(f"{place}.values", f"is {shown(choices)}: a list is needed")
        numbers = {
            key: self.number(entry[key], f"{place}.{key}", units)
            for key in (*needed, *optional)
            if key in entry and key != "values"
        }
        try:
            return Distribution(kind, self.scalars(choices, f"{place}.values", units), **numbers)
        except DrawError as error:
            raise self.error(place, f"distribution {kind}: {error}") from None
