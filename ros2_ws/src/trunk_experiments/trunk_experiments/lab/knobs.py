"""Which parameters of a plan are knobs: each is a number of the loop, or several numbers with its value.

Nothing is known of any parameter: each is tried with other values, and all else must keep its bits.
"""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite
from typing import Any

from trunk_control.rule_base import RuleBaseConfig
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    Value,
    changed,
    declarations,
    values_of,
)
from trunk_runs.plan import RunPlan

from ..export_c.library import COMPUTED, form_of, made_of, varying
from .experiment import NO_LINKS
from .webassembly import numbers_of_loop, values_of_loop

_TRIES = 8
SEED = "seed"  # the page draws the sensors' noise itself
# `simulator.initial_state` is put into the loop by `step.at_rest`, which a lab runs itself.
_FALLEN = "state.trunk.fallen"


@dataclass(frozen=True)
class Knob:
    """A parameter's place in the loop: of each element, the indices of its numbers and their kind.

    ``low`` and ``high`` may be narrower than the declaration's bounds; ``excluded`` values are no knob's.
    """

    places: tuple[tuple[int, ...], ...]
    kind: str
    low: float
    high: float
    excluded: tuple[float, ...] = ()
    array: bool = False

    def filled(self, value: float) -> Any:
        """Return the parameter with this value, of all its elements."""
        return (value,) * len(self.places) if self.array else value


@dataclass(frozen=True)
class RuleKnob:
    """A rule table's place in the loop: of its first number, row by row, and the value of each label."""

    first: int
    rows: int
    columns: int
    labels: Mapping[str, float]

    @property
    def numbers(self) -> range:
        """The places of its numbers."""
        return range(self.first, self.first + self.rows * self.columns)


@dataclass(frozen=True)
class Order:
    """A rule that joins two parameters: ``less`` < ``more``, or, unless ``strict``, equal."""

    less: str
    more: str
    strict: bool


class NoKnobError(Exception):
    """Why a parameter is no knob, as a phrase."""


def with_value(plan: RunPlan, node: str, name: str, value: Value) -> RunPlan:
    """Return a plan with one other value. Raises ParameterError, PlanError."""
    other = changed(plan.configs[node], {name: value})
    if node in plan.controllers:
        return replace(plan, controllers={**plan.controllers, node: other})
    return replace(plan, **{node: other})


@dataclass
class NodeKnobs:
    """A node's knobs by parameter, why the others are none, and the rules that join knobs."""

    knobs: dict[str, Knob | RuleKnob]
    refused: dict[str, str]
    orders: list[Order]


class KnobSearch:
    """Tries the parameters of a plan's nodes, one after the other."""

    def __init__(self, plan: RunPlan) -> None:
        """Take a plan with one controller."""
        self.plan = plan
        self._numbers = numbers_of_loop(plan)
        self._fallen = [number.place for number in self._numbers].index(_FALLEN)
        places = itertools.count()
        self._places = [next(places) if number.place else -1 for number in self._numbers]

    def of(self, node: str) -> NodeKnobs:
        """Return the knobs of a node."""
        knobs: dict[str, Knob | RuleKnob] = {}
        refused: dict[str, str] = {}
        for name in declarations(type(self.plan.configs[node])):
            try:
                knobs[name] = self._knob(node, name)
            except NoKnobError as error:
                refused[name] = str(error)
        tables = [knob.numbers for knob in knobs.values() if isinstance(knob, RuleKnob)]
        for name, knob in list(knobs.items()):
            if isinstance(knob, Knob) and any(
                place in table for table in tables for places in knob.places for place in places
            ):
                del knobs[name]
                refused[name] = "where it is depends on the rules"
        numbers = {name: knob for name, knob in knobs.items() if isinstance(knob, Knob)}
        single = [name for name, knob in numbers.items() if not knob.array]
        orders = list(self._orders(node, single))
        for first, second in itertools.combinations(numbers, 2):
            if not any({order.less, order.more} == {first, second} for order in orders):
                name, other = (second, first) if numbers[second].array else (first, second)
                knobs[name] = numbers[name] = self._narrowed(node, numbers, name, other)
        return NodeKnobs(knobs, refused, orders)

    def _knob(self, node: str, name: str) -> Knob | RuleKnob:
        if node == "simulator" and (name.startswith("link.") or name == "sensor.dropout"):
            raise NoKnobError(NO_LINKS)
        config = self.plan.configs[node]
        declared = declarations(type(config))[name]
        now: Any = values_of(config)[name]
        if declared.table and isinstance(config, RuleBaseConfig):
            return self._table(node, name, config)
        if declared.kind in ("double", "integer") and name != "sensor.seed":
            return self._search(node, declared, now, lambda value: value)
        if (node, name) == ("simulator", "sensor.seed"):
            return Knob((), SEED, float(declared.minimum or 0), float(declared.maximum or inf))
        if declared.kind == "double array":
            return self._array(node, declared, now)
        raise NoKnobError("it is no number")

    def _orders(self, node: str, names: Sequence[str]) -> Iterator[Order]:
        """Yield the rules that join two of a node's knobs."""
        declared = declarations(type(self.plan.configs[node]))
        for less, more in itertools.permutations(names, 2):
            level = _inside(declared[less], declared[more])
            if level is None or self._fits(node, {less: level * 1.5, more: level}):
                continue
            if self._fits(node, {less: level, more: level * 1.5}):
                yield Order(less, more, not self._fits(node, {less: level, more: level}))

    def _fits(self, node: str, values: Mapping[str, Value]) -> bool:
        try:
            changed(self.plan.configs[node], values)
        except ParameterError:
            return False
        return True

    def _narrowed(self, node: str, knobs: Mapping[str, Knob], first: str, second: str) -> Knob:
        """Return a knob with bounds at which the ``second`` one's are allowed, too."""
        knob, other = knobs[first], {second: knobs[second].filled(knobs[second].high)}
        if not (isfinite(knob.high) and isfinite(knobs[second].high) and self._fits(node, other)):
            return knob
        if not self._fits(node, {first: knob.filled(knob.high)}):
            return knob
        while knob.high > 1.0 and not self._fits(node, {first: knob.filled(knob.high), **other}):
            knob = replace(knob, low=knob.low / 10.0, high=knob.high / 10.0)
        return knob

    def _loop(self, node: str, name: str, value: Any) -> list[object]:
        """Return the loop's values with another value. Raises ParameterError, PlanError."""
        values = values_of_loop(with_value(self.plan, node, name, value))
        values[self._fallen] = None
        return values

    def _array(self, node: str, declared: Declaration, now: Any) -> Knob:
        if not len(now):
            raise NoKnobError("it has no elements")

        def with_item(i: int, value: Any) -> Value:
            return (*now[:i], value, *now[i + 1 :])

        knobs = [
            self._search(node, declared, item, partial(with_item, i)) for i, item in enumerate(now)
        ]
        if len({knob.kind for knob in knobs}) > 1 or any(knob.excluded for knob in knobs):
            raise NoKnobError("its elements are used differently")
        places = tuple(knob.places[0] for knob in knobs)
        low, high = max(knob.low for knob in knobs), min(knob.high for knob in knobs)
        return Knob(places, knobs[0].kind, low, high, array=True)

    def _search(
        self, node: str, declared: Declaration, now: Any, whole: Callable[[Any], Value]
    ) -> Knob:
        """Return the knob of one number: over all that is allowed, or what is not below or above 0."""
        low = max(v for v in (declared.minimum, declared.above, -inf) if v is not None)
        high = inf if declared.maximum is None else declared.maximum
        special = {0.0, low, high, -1.0, 1.0} - {now, inf, -inf}
        values = [v for v in (*special, *_tries(declared, now)) if low <= v <= high]
        kind = int if declared.kind == "integer" else float
        made = made_of(
            [now, *map(kind, values)],
            lambda value: self._loop(node, declared.name, whole(value)),
        )
        reason = ""
        for bottom, top in ((low, high), (max(low, 0.0), high), (low, min(high, 0.0))):
            inside = {v: texts for v, texts in made.items() if bottom <= v <= top}
            tried = {v: texts for v, texts in inside.items() if v not in special}
            if now not in inside or len(tried) < 2:
                continue
            form = form_of(tried)
            changing = [] if form is None else varying(form)
            places = tuple(self._places[i] for i in changing)
            if form is None or -1 in places:
                reason = reason or "it changes the form of the equations"
            elif not places:
                reason = reason or "the loop does not use it"
            elif len(kinds := {form[i] for i in changing}) > 1 or COMPUTED in kinds:
                numbers = f"{len(places)} numbers are" if len(places) > 1 else "a number is"
                reason = reason or f"{numbers} computed from it"
            else:
                given = [v for v in special if v in inside]
                excluded = tuple(v for v in given if form_of({**tried, v: inside[v]}) != form)
                return Knob((places,), kinds.pop(), bottom, top, excluded)
        raise NoKnobError(reason or "no other value is allowed")

    def _table(self, node: str, name: str, config: RuleBaseConfig) -> RuleKnob:
        table = next(table for table in config.tables if f"rules.{table.name}" == name)
        rows: Any = values_of(config)[name]
        cells = [row.split() for row in rows]
        labels = dict(table.centers)
        rng = random.Random(name)
        chosen = [[rng.choice(list(labels)) for _ in row] for row in cells]
        other = tuple(map(" ".join, chosen))
        made = made_of((rows, other), partial(self._loop, node, name))
        before, after = made[rows], made.get(other)
        if after is None or after == before:
            raise NoKnobError("the loop does not use it")
        numbers = [repr(labels[label]) for row in chosen for label in row]
        for i, first in enumerate(self._places):
            if first >= 0 and [*before[:i], *numbers, *before[i + len(numbers) :]] == after:
                return RuleKnob(first, len(cells), len(cells[0]), labels)
        raise NoKnobError("its labels are not numbers of the loop")


def _tries(declared: Declaration, now: float) -> Iterator[float]:
    """Yield values of both signs: near the present one, and of other sizes."""
    rng = random.Random(declared.name)
    size = abs(now) if isfinite(now) and now else 1.0
    for k in range(_TRIES):
        scale = 1.0 + 0.1 * rng.random() if k < _TRIES // 2 else 10.0 ** rng.uniform(-2.0, 2.0)
        yield from (size * scale, -size * scale)


def _inside(a: Declaration, b: Declaration) -> float | None:
    """Return a value that both allow, with half as much again; None if there is none."""
    low = max([v for d in (a, b) for v in (d.minimum, d.above) if v is not None], default=-inf)
    high = min([d.maximum for d in (a, b) if d.maximum is not None], default=inf)
    for level in (1.0, 0.1, 10.0, 1e-3):
        if low < level and level * 1.5 < high:
            return level
    return None
