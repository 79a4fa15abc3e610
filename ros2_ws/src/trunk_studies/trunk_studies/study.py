"""A study: which runs a sweep makes, a table of one row each, and its file. `rows` makes its plans.

The file is strictly checked YAML, each mistake one line; docs/sweep.md describes it. A number may have a
unit: one of those of the parameters that its entry varies.

Row = ((grid point) x runs + draw) x controllers + controller: what is drawn, seeds included, depends
only on the draw, so that all controllers and all grid points meet the same conditions. Draws are seeded,
each variable's from its own stream, so that adding one changes no other's values. Numbers between 0 and 1
become values by functions of our own (`elementary`, `noise`): a study draws the same on every machine.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from math import degrees, inf
from pathlib import Path
from typing import Any

import numpy as np

from trunk_core.arrays import Floats
from trunk_core.elementary import exp, log
from trunk_core.errors import DrawError, StudyError, TrunkError, did_you_mean
from trunk_core.parameters.declarations import UnitError, declarations, looks_like_quantity
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.parameters.to_si import read_quantity, units_of
from trunk_core.text import shortened
from trunk_core.yaml_text import YamlTextError, load, on_one_line
from trunk_evidence.run_metrics import QUANTITIES
from trunk_runs.nodes import CONTROLLERS, NODES, config_class
from trunk_runs.scenario import plant_of_run
from trunk_sim.noise import probability_below, quantile
from trunk_sim.plant import PLANTS, TRUNK

Scalar = bool | int | float | str
HOWS = ("value", "factor", "offset")
SPACINGS = ("linear", "log")
MAX_RUNS = 100_000_000
# Columns of the results besides the variables.
RESERVED = (
    *("run", "controller", "point", "draw", "seed"),
    *("status", "reason", "fell", "diverged_at_s", *QUANTITIES),
)
_EXACT = 2.0**53
_SMALLEST = 2.0**-54  # instead of 0, at which a normal variable is -inf
# What each needs, and what it may have.
DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "uniform": (("low", "high"), ()),
    "loguniform": (("low", "high"), ()),
    "normal": (("mean", "std"), ("low", "high")),
    "integers": (("low", "high"), ()),
    "choice": (("values",), ()),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution by name; ``low`` and ``high`` truncate a normal one, integers include both ends."""

    kind: str
    values: tuple[Any, ...] = ()
    low: float = -inf
    high: float = inf
    mean: float = 0.0
    std: float = 0.0

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise DrawError(f"low {self.low:g} is above high {self.high:g}")
        if self.kind == "loguniform" and self.low <= 0.0:
            raise DrawError(f"low is {self.low:g}: a number > 0 is needed")
        if self.kind == "normal" and self.std <= 0.0:
            raise DrawError(f"std is {self.std:g}: a number > 0 is needed")
        if self.kind == "integers" and (self.low % 1.0 or self.high % 1.0):
            raise DrawError(f"low {self.low:g} and high {self.high:g} must be whole numbers")
        if self.kind == "integers" and max(-self.low, self.high) > _EXACT:
            raise DrawError(
                f"low {self.low:g} to high {self.high:g}: at most 2^53 either way, exact as a double"
            )

    def draw(self, count: int, seed: int, name: str) -> list[Any]:
        """Return ``count`` values of the stream of a seed and a name.

        A longer draw starts with the same values.
        """
        generator = stream(seed, name)
        if self.kind == "integers":
            whole: list[Any] = generator.integers(
                int(self.low), int(self.high), count, endpoint=True
            ).tolist()
            return whole
        return self.at(generator.random(count))

    def at(self, u: Floats) -> list[Any]:
        """Return the values at some fractions, 0 <= u < 1, of the distribution."""
        if self.kind == "integers":
            whole = np.floor(u * (self.high - self.low + 1.0)) + self.low
            return [int(number) for number in whole]
        if self.kind == "choice":
            return [self.values[int(i)] for i in u * len(self.values)]
        if self.kind == "uniform":
            drawn = self.low + (self.high - self.low) * u
        elif self.kind == "loguniform":
            low, high = log(self.low), log(self.high)
            drawn = np.array([exp(low + (high - low) * fraction) for fraction in u.tolist()])
        else:
            below, above = (
                probability_below((end - self.mean) / self.std) for end in (self.low, self.high)
            )
            p = below + (above - below) * np.maximum(u, _SMALLEST)
            drawn = self.mean + self.std * np.array(
                [quantile(probability) for probability in p.tolist()]
            )
        values: list[Any] = np.clip(drawn, self.low, self.high).tolist()
        return values


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of a variable: PCG64, seeded by the study's seed and the variable's name."""
    words = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))


@dataclass(frozen=True)
class Target:
    """One parameter of a node, or of whichever controller runs; ``index`` for an array's element."""

    node: str  # "controller" means the one that runs
    name: str
    index: int | None = None

    def node_with(self, contender: ContenderSpec) -> str:
        """Return the name of the node in a contender's runs."""
        return contender.node if self.node == "controller" else self.node

    @property
    def parameter(self) -> str:
        """The name with the index: ``initial.position[1]``."""
        return self.name if self.index is None else f"{self.name}[{self.index}]"

    def __str__(self) -> str:
        return f"{self.node}.{self.parameter}"


@dataclass(frozen=True)
class Variable:
    """What varies: a column of the results. Either ``values`` (a grid) or ``distribution`` (drawn)."""

    name: str
    targets: tuple[Target, ...]
    how: str  # value: replaces the parameter; factor: multiplies it; offset: is added to it
    values: tuple[Scalar, ...] = ()
    distribution: Distribution | None = None
    written: tuple[str, ...] = ()  # its numbers with units, as in the file; the others are in SI


@dataclass(frozen=True)
class ContenderSpec:
    """One controller of the study, with its own node, parameter files and values."""

    label: str
    node: str
    params: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class StudySpec:
    """A study as read from its file; ``text`` is the file's content."""

    source: str
    text: str
    scenario: str
    contenders: tuple[ContenderSpec, ...]
    variables: tuple[Variable, ...]
    params: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    rate: float | None = None  # Hz
    duration: float | None = None  # s
    runs: int = 1  # draws per grid point
    seed: int = 1
    block: int = 480  # runs: 30 times as many as lanes
    plant: str = TRUNK

    @property
    def words(self) -> Callable[[str], str]:
        """The function that puts a text of ours into the words of the study's plant, if that is installed."""
        known = self.plant != TRUNK and self.plant in PLANTS.names
        return PLANTS.named(self.plant).of_drive if known else str

    @property
    def grid(self) -> tuple[Variable, ...]:
        """The variables with given values."""
        return tuple(v for v in self.variables if v.distribution is None)

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values of each grid variable."""
        return tuple(len(v.values) for v in self.grid)

    @property
    def total(self) -> int:
        """The number of runs in all."""
        points = 1
        for size in self.shape:
            points *= size
        return points * self.runs * len(self.contenders)


def design(study: StudySpec, first: int, last: int) -> dict[str, list[Any]]:
    """Return columns of the rows first <= row < last: run, controller, point, draw, seed, variables."""
    rows = np.arange(first, last)
    labels = [contender.label for contender in study.contenders]
    which = rows % len(labels)
    draw = rows // len(labels) % study.runs
    point = rows // (len(labels) * study.runs)
    drawn = drawn_values(study)
    places = np.unravel_index(point, study.shape) if study.shape else ()
    at = dict(zip((v.name for v in study.grid), places, strict=True))
    columns: dict[str, list[Any]] = {
        "run": rows.tolist(),
        "controller": [labels[i] for i in which],
        "point": point.tolist(),
        "draw": draw.tolist(),
        "seed": [drawn[""][i] if study.runs > 1 else None for i in draw],
    }
    for v in study.variables:
        chosen = chosen_values(study, v)
        columns[v.name] = [chosen[i] for i in at.get(v.name, draw)]
    return columns


def chosen_values(study: StudySpec, v: Variable) -> Sequence[Any]:
    """Return a variable's given values, or those drawn."""
    return v.values if v.distribution is None else drawn_values(study)[v.name]


@lru_cache(maxsize=1)
def drawn_values(study: StudySpec) -> dict[str, list[Any]]:
    """Return each drawn variable's values by name, and the noise seeds under an empty name."""
    values = {
        v.name: v.distribution.draw(study.runs, study.seed, v.name)
        for v in study.variables
        if v.distribution is not None
    }
    return {**values, "": stream(study.seed, "").integers(2**31, size=study.runs).tolist()}


_UNIT = re.compile(r"[-+.\d]+(?:[eE][-+]?\d+)?\s*(\D.*)")
Units = tuple[tuple[str, ...], ...]  # a number has to fit each inner tuple, by any one of its units


def shipped_studies() -> dict[str, Path]:
    """Return the shipped studies by bare name."""
    folder = Path(str(files(__package__))) / "studies"
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


class _Reader:
    """Turns a YAML tree into a study. All methods raise StudyError, which names file and place."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.plant = TRUNK

    def error(self, place: str, message: str) -> StudyError:
        return StudyError(f"{self.source}: {place}: {message}")

    def mapping(self, value: object, place: str, known: tuple[str, ...] = ()) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.error(place, f"is {_quoted(value)}: a mapping is needed")
        for key in value:
            if known and key not in known:
                raise self.error(place, f"unknown key {key!r}: one of {', '.join(known)}")
        return value

    def text(self, value: object, place: str, choices: tuple[str, ...] = ()) -> str:
        if not isinstance(value, str) or (choices and value not in choices):
            raise self.error(
                place, f"is {_quoted(value)}: {', '.join(choices) or 'text'} is needed"
            )
        return value

    def texts(self, value: object, place: str) -> tuple[str, ...]:
        items = [value] if isinstance(value, str) else value
        if not isinstance(items, list) or not all(isinstance(item, str) for item in items):
            raise self.error(place, f"is {_quoted(value)}: a list of strings is needed")
        return tuple(items)

    def number(self, value: object, place: str, units: Units = ()) -> float:
        if units and looks_like_quantity(value):
            try:
                value = number_of(str(value), units)
            except UnitError as error:
                raise self.error(place, f"is {_quoted(value)}: {error}") from None
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise self.error(place, f"is {_quoted(value)}: a finite number is needed")
        return float(value)

    def integer(self, value: object, place: str, low: int, high: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(
                place, f"is {_quoted(value)}: a whole number from {low} to {high} is needed"
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
                place, f"is {_quoted(values)}: all numbers, all strings or all bools are needed"
            )
        return scalars

    def scalar(self, value: object, place: str, units: Units) -> Scalar:
        if isinstance(value, bool | int):
            return value
        quantity = units and looks_like_quantity(value)
        if isinstance(value, str) and not quantity:
            return value
        return self.number(value, place, units)

    def study(self, tree: object, text: str) -> StudySpec:
        known = ("scenario", "controllers", "params", "set", "rate", "duration")
        entries = self.mapping(tree, "the file", (*known, "runs", "seed", "block", "vary"))
        for key in ("scenario", "controllers", "vary"):
            if key not in entries:
                raise self.error(key, "missing: every study needs it")
        contenders = self.contenders(entries["controllers"])
        self.plant = self.plant_in(entries)
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
            plant=self.plant,
        )
        if study.total > MAX_RUNS:
            raise self.error("vary", f"{study.total} runs in all: at most {MAX_RUNS} are allowed")
        return study

    def plant_in(self, entries: Mapping[str, Any]) -> str:
        """Return the name of a study's plant; the trunk's where a plan will be refused."""
        params, settings = entries.get("params", []), entries.get("set", {})
        with suppress(TrunkError):
            return plant_of_run(
                self.text(entries["scenario"], "scenario"),
                self.texts(params, "params"),
                self.settings(settings, "set"),
            ).name
        return TRUNK

    def settings(self, value: object, place: str) -> tuple[str, ...]:
        entries = self.mapping(value, place)
        return tuple(f"{name}={on_one_line(value)}" for name, value in entries.items())

    def contenders(self, value: object) -> tuple[ContenderSpec, ...]:
        entries = value
        if isinstance(value, list):
            entries = dict.fromkeys(names := self.texts(value, "controllers"))
            if twice := [name for name in entries if names.count(name) > 1]:
                text = f"{twice[0]} is there twice: give each a label, LABEL: {{node: {twice[0]}}}"
                raise self.error("controllers", text)
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
        units = units_for(targets, how, contenders, self.plant)
        written = written_in(rest) if units else ()
        if "distribution" in rest:
            drawn = self.distribution(rest, place, units)
            return Variable(name, targets, how, distribution=drawn, written=written)
        return Variable(name, targets, how, self.values(rest, place, units), written=written)

    def target(self, text: str, place: str) -> Target:
        nodes = ("simulator", "disturbance", "controller", *CONTROLLERS)
        match = re.fullmatch(r"(\w+)\.([\w.]+?)(?:\[(\d+)\])?", text, re.ASCII)
        if match is None or match[1] not in nodes:
            raise self.error(
                place,
                f"parameter {text!r}: NODE.PARAM or NODE.PARAM[INDEX] is needed, NODE one of "
                f"{', '.join(nodes)}",
            )
        if match[2] == PLANT_NAME:
            raise self.error(
                place, f"{text}: a study has one plant: name it in set, or in the scenario"
            )
        return Target(match[1], match[2], None if match[3] is None else int(match[3]))

    def values(self, entry: dict[str, Any], place: str, units: Units) -> tuple[Scalar, ...]:
        if "values" in entry:
            self.mapping(entry, place, ("values",))
            values = entry["values"]
            if not isinstance(values, list) or not values:
                raise self.error(f"{place}.values", f"is {_quoted(values)}: a list is needed")
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
            raise self.error(f"{place}.values", f"is {_quoted(choices)}: a list is needed")
        numbers = {
            key: self.number(entry[key], f"{place}.{key}", units)
            for key in (*needed, *optional)
            if key in entry and key != "values"
        }
        try:
            return Distribution(kind, self.scalars(choices, f"{place}.values", units), **numbers)
        except DrawError as error:
            raise self.error(place, f"distribution {kind}: {error}") from None


def _quoted(value: object) -> str:
    """Return a value as an error quotes it."""
    return shortened(repr(value), 60)


def units_for(
    targets: Sequence[Target], how: str, contenders: Sequence[ContenderSpec], plant: str
) -> Units:
    """Return the units of an entry's numbers; none where a parameter is no double.

    A factor has no unit. Which unit counts where another parameter chooses it, `check_units` says.
    """
    units: dict[tuple[str, ...], None] = {}
    for target in targets:
        for node in {target.node_with(contender): None for contender in contenders}:
            declared = declarations(config_class(node, {PLANT_NAME: plant})).get(target.name)
            if declared is None:  # refused later, by name
                continue
            if not declared.kind.startswith("double"):
                return ()
            elements = units_of(declared)
            units[elements[min(target.index or 0, len(elements) - 1)]] = None
    return (("",),) if how == "factor" else tuple(units)


def written_in(entry: Mapping[str, object]) -> tuple[str, ...]:
    """Return the numbers with units in an entry's values, as written."""
    items = [
        item for value in entry.values() for item in (value if isinstance(value, list) else [value])
    ]
    return tuple(item for item in items if isinstance(item, str) and looks_like_quantity(item))


def number_of(text: str, units: Units) -> float:
    """Return a number with a unit in SI units. Raises UnitError unless it fits all of ``units``."""
    numbers = [read_quantity(text, *allowed) for allowed in units]
    return numbers[0]


def shown_unit(study: StudySpec, v: Variable) -> tuple[str, float]:
    """Return the unit in which a variable's numbers are shown, and what its SI numbers are multiplied by.

    It is the one of the entry's first number that has one, else the parameter's, angles in degrees; empty
    where several are possible.
    """
    if v.how == "factor":
        return "factor", 1.0
    allowed = {
        unit
        for units in units_for(v.targets, v.how, study.contenders, study.plant)
        for unit in units
    }
    if len(allowed) > 1:  # another parameter chooses
        chosen = {unit for target in v.targets for unit in _chosen(study, target)}
        allowed = chosen if len(chosen) == 1 else allowed
    typed = _UNIT.sub(r"\1", v.written[0]) if v.written else ""
    for unit in allowed if typed else ():
        with suppress(UnitError):
            scale = 1.0 / read_quantity(f"1 {typed}", unit)
            return (unit if scale == 1.0 else "°" if unit == "rad" else typed), scale
    if allowed == {"rad"}:
        return "°", degrees(1.0)
    return (min(allowed), 1.0) if len(allowed) == 1 else ("", 1.0)


def shown(study: StudySpec, name: str, value: object) -> str:
    """Return one of a study's numbers with the unit in which it is shown; anything else as it is."""
    if not isinstance(value, float | int) or isinstance(value, bool):
        return str(value)
    unit, scale = shown_unit(study, next(v for v in study.variables if v.name == name))
    number = f"{value * scale:.6g}"
    return number + unit if unit == "°" else f"{number} {unit}".replace(" factor", " times").strip()


def _chosen(study: StudySpec, target: Target) -> Iterable[str]:
    """Yield the unit that a study's own settings choose for a parameter."""
    declared = (
        declarations(config_class(target.node, {PLANT_NAME: study.plant})).get(target.name)
        if target.node in NODES
        else None
    )
    for text in study.settings if declared and declared.unit_by else ():
        name, _, value = text.partition("=")
        if declared and name == f"{target.node}.{declared.unit_by}":
            yield from units_of(declared, {declared.unit_by: value})[0]
