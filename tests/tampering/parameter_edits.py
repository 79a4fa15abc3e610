"""Edits of parameters: each declared one of each node, and the messages that carry them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import inf
from typing import Any

from ros2_ws.src.trunk_msgs_util.test.mcap_files import Content

from trunk_experiments.plans.nodes import NODES
from trunk_msgs_util.parameters.declarations import Declaration, declarations
from trunk_msgs_util.recording.schemas import parse_parameter_event
from trunk_msgs_util.units import NANOSECONDS

from .joint_edits import TRUTH
from .messages import (
    LOG,
    PARAMETERS,
    PUBLISH,
    SEQUENCE,
    Edit,
    move,
    parsed,
    renumber,
    sample_of,
    store,
)

_FIELDS = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value",
           7: "integer_array_value", 8: "double_array_value", 9: "string_array_value"}  # fmt: skip


def parameter_edits(found: Content) -> Iterator[Edit]:
    """Yield all edits of parameters."""
    period = sample_of(found.of(TRUTH)[1]).stamp_ns
    for number, message in enumerate(found.of(PARAMETERS)):
        told = parse_parameter_event(message[2])
        node = told.node.strip("/")
        changed = "changed" if told.changed else "set"
        yield from _of_message(f"{node}, {changed}", number, period)
        for place, name in enumerate(told.new or told.changed):
            declared = declarations(NODES[node].config)[name]
            yield from _of_parameter(f"{node}.{name}, {changed}", number, place, declared)


def _listed(value: Any) -> list[Any]:
    return value.new_parameters or value.changed_parameters


def _of_parameter(what: str, number: int, place: int, declared: Declaration) -> Iterator[Edit]:
    def edit(change: Callable[[list[Any], Any], object], found: Content) -> object:
        message = found.of(PARAMETERS)[number]
        value = parsed(message)
        listed = _listed(value)
        done = change(listed, listed[place])
        store(message, value)
        return done

    def other(which: int, _: list[Any], parameter: Any) -> object:
        field = _FIELDS[parameter.value.type]
        values = list(_others(declared, getattr(parameter.value, field)))
        if which >= len(values):
            return False
        setattr(parameter.value, field, values[which])
        return None

    def retyped(_: list[Any], parameter: Any) -> None:
        value = parameter.value
        value.type = {1: 2, 2: 3, 3: 2, 4: 9, 7: 8, 8: 9, 9: 4}[value.type]

    def unset(_: list[Any], parameter: Any) -> None:
        parameter.value.type = 0

    def smuggled(_: list[Any], parameter: Any) -> None:
        parameter.value.string_value += "x"

    for which in range(3):
        yield Edit(
            "parameter", f"{what}, another value ({which})", partial(edit, partial(other, which))
        )
    changes: dict[str, Callable[[list[Any], Any], object]] = {
        "removed": lambda listed, one: listed.remove(one),
        "renamed": lambda _, one: setattr(one, "name", one.name + "_"),
        "doubled": lambda listed, one: listed.append(one),
        "another type": retyped,
        "not set": unset,
    }
    if declared.kind != "string":
        changes["a value of another type besides"] = smuggled
    for name, change in changes.items():
        yield Edit(f"parameter {name}", what, partial(edit, change))


def _others(declared: Declaration, value: Any) -> Iterator[Any]:
    """Yield up to three other values of a parameter that may be allowed: near, far, simple."""
    kind = declared.kind
    if declared.choices and kind == "string":
        yield from [one for one in declared.choices if one != value][:3]
    elif kind == "bool":
        yield not value
    elif kind == "integer":
        yield from (value + 1, value * 3 + 2)
    elif kind == "double":
        if value == inf:
            yield from (1e-3, 1e6)
        elif value == -inf:
            yield from (-1e-3, -1e6)
        else:
            yield from (value * 1.5 if value else 1e-2, value * 0.1 if value else -1e-2)
    elif kind == "string":
        yield value + "x"
    elif kind == "string array":
        items = list(value)
        yield [*items, items[0] if items else "other"]
        if items:
            yield items[:-1]
            yield [" ".join(reversed(items[0].split())) if " " in items[0] else "other", *items[1:]]
    elif kind.endswith("array"):
        items = [float(item) for item in value]
        yield type(value)(shape=(len(items) + 1,), dtype=value.dtype) * 0 + 0.1
        if items:
            yield value * 1.5
            yield value[:-1]


def _of_message(what: str, number: int, period: int) -> Iterator[Edit]:
    def edit(change: Callable[[Content, list[Any]], object], found: Content) -> None:
        change(found, found.of(PARAMETERS)[number])
        renumber(found)

    def inside(change: Callable[[Any], object], found: Content) -> None:
        message = found.of(PARAMETERS)[number]
        value = parsed(message)
        change(value)
        store(message, value)

    def stamped(by_ns: int, found: Content) -> None:
        message = found.of(PARAMETERS)[number]
        value = parsed(message)
        move(message, value, value.stamp, by_ns)

    def removed(found: Content, message: list[Any]) -> None:
        found.messages = [m for m in found.messages if m is not message]

    def doubled(found: Content, message: list[Any]) -> None:
        found.messages.append(list(message))

    def to_the_end(found: Content, message: list[Any]) -> None:
        removed(found, message)
        found.messages.append(message)

    def added(place: int, by: int, found: Content) -> None:
        found.of(PARAMETERS)[number][place] += by

    def turned(value: Any) -> None:
        _listed(value).reverse()

    def other_list(value: Any) -> None:
        value.new_parameters, value.changed_parameters = (
            value.changed_parameters,
            value.new_parameters,
        )

    def other_node(value: Any) -> None:
        value.node = "/pid" if value.node != "/pid" else "/fuzzy_pid"

    kind = "parameters' message"
    yield Edit(kind, f"{what}, removed", partial(edit, removed))
    yield Edit(kind, f"{what}, doubled", partial(edit, doubled))
    yield Edit(kind, f"{what}, to the end", partial(edit, to_the_end))
    for by, by_ns in {"+ 1 ns": 1, "+ a period": period, "- a period": -period,
                      "+ 1 s": NANOSECONDS, "to -1 ns": -(2**60)}.items():  # fmt: skip
        yield Edit(kind, f"{what}, stamp {by}", partial(stamped, by_ns))
    for field, by in {LOG: "log time", PUBLISH: "publish time", SEQUENCE: "sequence"}.items():
        yield Edit(kind, f"{what}, {by} + 1", partial(added, field, 1))
    yield Edit(kind, f"{what}, order of parameters", partial(inside, turned))
    yield Edit(kind, f"{what}, in the other list", partial(inside, other_list))
    yield Edit(kind, f"{what}, of another node", partial(inside, other_node))
    yield Edit(
        kind, f"{what}, of an unknown node", partial(inside, lambda v: setattr(v, "node", "/other"))
    )
    deleted = partial(inside, lambda v: v.deleted_parameters.extend(_listed(v)[:1]))
    yield Edit(kind, f"{what}, one deleted too", deleted)
