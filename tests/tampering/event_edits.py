"""Edits of what the nodes report: each kind of event of each node, and events that nobody sent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ros2_ws.src.trunk_msgs_util.test.mcap_files import Content
from ros2_ws.src.trunk_msgs_util.test.test_events import CARRIES

from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.schemas import build, event, parse_event
from trunk_msgs_util.units import NANOSECONDS

from .joint_edits import TRUTH
from .messages import EVENTS, LOG, PUBLISH, SEQUENCE, Edit, move, parsed, renumber, sample_of, store

_NODES = ("recorder", "fuzzy_pid", "pid", "disturbance", "simulator")


def event_edits(found: Content) -> Iterator[Edit]:
    """Yield all edits of the run's events."""
    period = sample_of(found.of(TRUTH)[1]).stamp_ns
    seen = set()
    for number, message in enumerate(found.of(EVENTS)):
        told = parse_event(message[2])
        if (told.node, told.message) not in seen:
            seen.add((told.node, told.message))
            values = tuple(told.values)
            yield from _of_one(f"{told.node} {told.message}", number, values, period)
    yield from _all()
    yield from _added(found)


def _of_one(what: str, number: int, keys: tuple[str, ...], period: int) -> Iterator[Edit]:
    def edit(change: Callable[[Content, list[Any]], object], found: Content) -> None:
        change(found, found.of(EVENTS)[number])
        renumber(found)

    def with_status(change: Callable[[Any, Any], object], found: Content) -> None:
        message = found.of(EVENTS)[number]
        value = parsed(message)
        change(value, value.status[0])
        store(message, value)

    def stamped(by_ns: int, found: Content) -> None:
        message = found.of(EVENTS)[number]
        value = parsed(message)
        move(message, value, value.header.stamp, by_ns)

    def doubled(found: Content, message: list[Any]) -> None:
        found.messages.append(list(message))

    def doubled_at_once(found: Content, message: list[Any]) -> None:
        where = next(i for i, m in enumerate(found.messages) if m is message)
        found.messages.insert(where, list(message))

    def to(place: int, found: Content, message: list[Any]) -> None:
        found.messages.remove(message)
        found.messages.insert(place if place >= 0 else len(found.messages), message)

    def added(place: int, by: int, found: Content) -> None:
        found.of(EVENTS)[number][place] += by

    def removed(found: Content, message: list[Any]) -> None:
        found.messages = [m for m in found.messages if m is not message]

    yield Edit("event removed", what, partial(edit, removed))
    yield Edit("event doubled", f"{what}, at the end", partial(edit, doubled))
    yield Edit("event doubled", f"{what}, at once", partial(edit, doubled_at_once))
    yield Edit("event moved", f"{what}, to the beginning", partial(edit, partial(to, 0)))
    yield Edit("event moved", f"{what}, to the end", partial(edit, partial(to, -1)))
    for by, by_ns in {"+ 1 ns": 1, "+ a period": period, "- a period": -period,
                      "+ 1 s": NANOSECONDS, "to -1 ns": -(2**60)}.items():  # fmt: skip
        yield Edit("event stamped", f"{what} {by}", partial(stamped, by_ns))
    for field, by in {LOG: "log time", PUBLISH: "publish time", SEQUENCE: "sequence"}.items():
        yield Edit("event's head", f"{what}, {by} + 1", partial(added, field, 1))

    def pair(key: str, value: str) -> Any:
        return build("diagnostic_msgs/msg/KeyValue", key=key, value=value)

    def other_value(key: str, _: Any, status: Any) -> None:
        one = next(pair for pair in status.values if pair.key == key)
        one.value = one.value[:-1] + ("1" if one.value[-1:] != "1" else "2")

    def without(key: str, _: Any, status: Any) -> None:
        status.values = [pair for pair in status.values if pair.key != key]

    def other_node(_: Any, status: Any) -> None:
        status.name = "/pid" if status.name != "/pid" else "/fuzzy_pid"

    def second_status(value: Any, status: Any) -> None:
        value.status.append(status)

    for key in keys:
        yield Edit(
            "event's values",
            f"{what}, another {key}",
            partial(with_status, partial(other_value, key)),
        )
        yield Edit(
            "event's values", f"{what}, without {key}", partial(with_status, partial(without, key))
        )
    changes: dict[str, Callable[[Any, Any], object]] = {
        "a value more": lambda _, status: status.values.append(pair("more", "1")),
        "of another node": other_node,
        "of an unknown node": lambda _, status: setattr(status, "name", "/other"),
        "another level": lambda _, status: setattr(status, "level", status.level + 1),
        "another word": lambda _, status: setattr(status, "message", "happened"),
        "a second status": second_status,
        "no status": lambda value, _: value.status.clear(),
        "another hardware_id": lambda _, status: setattr(status, "hardware_id", "robot"),
        "a frame_id": lambda value, _: setattr(value.header, "frame_id", "map"),
    }  # fmt: skip
    for name, change in changes.items():
        yield Edit("event's content", f"{what}, {name}", partial(with_status, change))


def _all() -> Iterator[Edit]:
    def keep(wanted: Callable[[Any], bool], found: Content) -> None:
        found.messages = [m for m in found.messages if m[0] != EVENTS or wanted(parse_event(m[2]))]
        renumber(found)

    yield Edit("events", "all removed", partial(keep, lambda told: False))
    for node in _NODES:
        kept = partial(keep, lambda told, node=node: told.node != f"/{node}")
        yield Edit("events", f"all of {node} removed", kept)
    for word in Event:
        kept = partial(keep, lambda told, word=word: told.message != word)
        yield Edit("events", f"all {word} removed", kept)


def _added(found: Content) -> Iterator[Edit]:
    """Yield events that no node sent, in the middle of the run and at its end."""
    stamps = [sample_of(message).stamp_ns for message in found.of(TRUTH)]
    values = {"rate": "500.0", "angle": "0.1", "limit": "0.5", "reason": "finished",
              "states": str(len(stamps)), "answers": "effort_command", "process": "boot.1.1",
              "link.state": "1 sent", "link.command": "1 sent", "sensor.dropout": "1",
              "disturbances": "9", "commanded": "1", "silent": "0",
              "node": "/mine", "middleware": "Cyclone DDS",
              "what": "commands not finite", "why": "the effort is nan"}  # fmt: skip

    def add(node: str, word: Event, row: int, found: Content) -> None:
        stamp_ns = stamps[row]
        carried = {key: {**values, "kind": node}[key] for key in CARRIES[word]}
        data = event(stamp_ns, f"/{node}", word, carried)
        truth = found.of(TRUTH)[row]
        where = next(i for i, m in enumerate(found.messages) if m is truth)
        found.messages.insert(where + 1, [EVENTS, truth[LOG], data, truth[LOG], 0])
        renumber(found)

    for node in _NODES:
        for word in Event:
            for place, row in {"half way": len(stamps) // 2, "at the end": len(stamps) - 1}.items():
                yield Edit("event added", f"{node} {word} {place}", partial(add, node, word, row))
