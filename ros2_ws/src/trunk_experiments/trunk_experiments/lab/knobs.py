"""Which parameters of a plan are knobs: each is a number of the loop, or several numbers with its value.

Nothing is known of any parameter: each is tried with other values, and all else must keep its bits.
"""

from __future__ import annotations

import itertools
import random
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite
from typing import Any

from trunk_control.rule_base import RuleBaseConfig
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    Value,
    build,
    declarations,
    values_of,
)
from trunk_core.units import nanoseconds
from trunk_runs.plan import RunPlan

from .experiment import NO_LINKS
from .webassembly import numbers_of_loop, values_of_loop

_TRIES = 8
_NANOSECONDS, _REAL, _INTEGER = "ns", "real", "integer"
SEED = "seed"  # the page draws the sensors' noise itself
# `simulator.initial_state` is put into the loop by `step.at_rest`, which a lab runs itself.
_COMPUTED = "state.trunk.fallen"


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
    config = plan.configs[node]
    changed = build(type(config), {**values_of(config), name: value})
    if node in plan.controllers:
        return replace(plan, controllers={**plan.controllers, node: changed})
    return replace(plan, **{node: changed})


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
        self._before = values_of_loop(plan)
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
        config = self.plan.configs[node]
        try:
            build(type(config), {**values_of(config), **values})
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

    def _changed(self, node: str, name: str, value: Value) -> dict[int, object] | None:
        """Return the numbers that another value changes, by place; None if the value is not allowed.

        Raises NoKnobError where it changes what is no number.
        """
        try:
            after = values_of_loop(with_value(self.plan, node, name, value))
        except (ParameterError, PlanError):
            return None
        if list(map(type, after)) != list(map(type, self._before)):
            raise NoKnobError("it changes the form of the equations")
        changed = {}
        for i, (old, new) in enumerate(zip(self._before, after, strict=True)):
            if _bits(old) == _bits(new) or self._numbers[i].place == _COMPUTED:
                continue
            if self._places[i] < 0:
                raise NoKnobError("it changes the form of the equations")
            changed[self._places[i]] = new
        return changed

    def _place(
        self, node: str, name: str, value: Value, number: float
    ) -> tuple[str, tuple[int, ...]]:
        """Return kind and places of the numbers that a value sets; none if it is not allowed.

        Raises NoKnobError.
        """
        changed = self._changed(node, name, value)
        if changed is None:
            return "", ()
        if not changed:
            raise NoKnobError("the loop does not use it")
        kinds = {_kind(new, number) for new in changed.values()}
        if len(kinds) > 1 or "" in kinds:
            several = len(changed) > 1
            numbers = f"{len(changed)} numbers are" if several else "a number is"
            raise NoKnobError(f"{numbers} computed from it")
        return kinds.pop(), tuple(changed)

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
        reason: NoKnobError | None = None
        for bottom, top in ((low, high), (max(low, 0.0), high), (low, min(high, 0.0))):
            if bottom <= now <= top and bottom < top:
                try:
                    return self._within(node, declared, now, whole, bottom, top)
                except NoKnobError as error:
                    reason = reason or error
        raise reason or NoKnobError("no other value is allowed")

    def _within(
        self,
        node: str,
        declared: Declaration,
        now: Any,
        whole: Callable[[Any], Value],
        low: float,
        high: float,
    ) -> Knob:
        places = {
            self._place(node, declared.name, whole(value), value)
            for value in _tries(declared, now, low, high)
        } - {("", ())}
        if len(places) != 1:
            reason = (
                "it sets other numbers at other values" if places else "no other value is allowed"
            )
            raise NoKnobError(reason)
        kind, place = places.pop()
        excluded = []
        for special in {0.0, low, high, -1.0, 1.0} - {now, inf, -inf}:
            if low <= special <= high:
                value = int(special) if declared.kind == "integer" else special
                try:
                    if self._place(node, declared.name, whole(value), special)[1] not in (
                        (),
                        place,
                    ):
                        excluded.append(special)
                except NoKnobError:
                    excluded.append(special)
        return Knob((place,), kind, low, high, tuple(excluded))

    def _table(self, node: str, name: str, config: RuleBaseConfig) -> RuleKnob:
        table = next(table for table in config.tables if f"rules.{table.name}" == name)
        rows: Any = values_of(config)[name]
        cells = [row.split() for row in rows]
        labels = dict(table.centers)
        rng = random.Random(name)
        for _ in range(3):
            chosen = [[rng.choice(list(labels)) for _ in row] for row in cells]
            changed = self._changed(node, name, tuple(map(" ".join, chosen)))
            if not changed:
                raise NoKnobError("the loop does not use it")
            first = self._start_of(changed, [labels[label] for row in chosen for label in row])
        return RuleKnob(first, len(cells), len(cells[0]), labels)

    def _start_of(self, changed: Mapping[int, object], numbers: Sequence[float]) -> int:
        """Return the place from which on a table's numbers stand. Raises NoKnobError."""
        present = {
            place: value
            for place, value in zip(self._places, self._before, strict=True)
            if place >= 0
        }
        after = {**present, **changed}
        for first in range(max(changed) - len(numbers) + 1, min(changed) + 1):
            if [_bits(after.get(first + i)) for i in range(len(numbers))] == list(
                map(_bits, numbers)
            ):
                return first
        raise NoKnobError("its labels are not numbers of the loop")


def _kind(new: object, number: float) -> str:
    """Return how a number of the loop comes from a parameter's; empty: it is computed otherwise."""
    if isinstance(new, float):
        return _REAL if _bits(new) == _bits(float(number)) else ""
    if isinstance(number, int):
        return _INTEGER if new == number else ""
    return _NANOSECONDS if isfinite(number) and new == nanoseconds(number) else ""


def _tries(declared: Declaration, now: float, low: float, high: float) -> Iterator[Any]:
    """Yield values between bounds: near the present one, and of other sizes."""
    rng = random.Random(declared.name)
    size = abs(now) if isfinite(now) and now else 1.0
    for k in range(_TRIES):
        scale = 1.0 + 0.1 * rng.random() if k < _TRIES // 2 else 10.0 ** rng.uniform(-2.0, 2.0)
        value = size * scale * (-1.0 if low < 0.0 and (high <= 0.0 or k % 2) else 1.0)
        value = max(low, min(value, high))
        if declared.kind == "integer":
            value = int(value)
        if value != now and value not in (low, high):
            yield value


def _inside(a: Declaration, b: Declaration) -> float | None:
    """Return a value that both allow, with half as much again; None if there is none."""
    low = max([v for d in (a, b) for v in (d.minimum, d.above) if v is not None], default=-inf)
    high = min([d.maximum for d in (a, b) if d.maximum is not None], default=inf)
    for level in (1.0, 0.1, 10.0, 1e-3):
        if low < level and level * 1.5 < high:
            return level
    return None


def _bits(value: Any) -> Any:
    return struct.pack("<d", value) if isinstance(value, float) else value
