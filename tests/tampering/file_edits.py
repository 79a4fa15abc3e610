"""Edits of the file around the messages: header, channels, schemas, origin, end, mode, topics, other runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from ros2_ws.src.trunk_msgs_util.test.mcap_files import Content

from trunk_msgs_util.recording.schemas import parse_event, parse_parameter_event
from trunk_msgs_util.recording.writer import END, PROVENANCE

from .joint_edits import COMMANDS, DISTURBANCE, LOOP, MEASURED, TRUTH, at
from .messages import (
    EVENTS,
    LOG,
    PARAMETERS,
    PUBLISH,
    Edit,
    parsed,
    put,
    renumber,
    sample_of,
    store,
)

_MODES = ("offline", "lockstep", "real_time")


def file_edits(found: Content) -> Iterator[Edit]:
    """Yield all edits of the file around the messages."""
    yield from _header()
    for topic in found.channels:
        yield from _channel(topic)
    for number in found.schemas:
        yield from _schema(number, found.schemas[number].name)
    for key in found.values(PROVENANCE):
        yield from _metadata_key("origin", PROVENANCE, key)
    for key in found.values(END):
        yield from _metadata_key("end", END, key)
    yield from _records()
    yield from _modes(found.values(PROVENANCE)["mode"])
    yield from _topics()
    yield from _runs()


def _header() -> Iterator[Edit]:
    yield Edit("header", "profile", lambda f: setattr(f, "profile", "ros1"))
    yield Edit("header", "library", lambda f: setattr(f, "library", "some recorder"))
    yield Edit("header", "no library", lambda f: setattr(f, "library", ""))
    version = lambda f: setattr(f, "library", f.library + "1")  # noqa: E731
    yield Edit("header", "library's version", version)
    attach = lambda f: f.attachments.append(("note.txt", b"trust me"))  # noqa: E731
    yield Edit("attachments", "one more", attach)


def _channel(topic: str) -> Iterator[Edit]:
    def changed(found: Content, **fields: Any) -> None:
        found.channels[topic] = replace(found.channels[topic], **fields)

    def renamed(found: Content) -> None:
        found.channels = {
            (f"{key}_" if key == topic else key): (
                replace(channel, topic=f"{topic}_") if key == topic else channel
            )
            for key, channel in found.channels.items()
        }
        for message in found.of(topic):
            message[0] = f"{topic}_"

    def gone(found: Content) -> None:
        del found.channels[topic]
        found.messages = [m for m in found.messages if m[0] != topic]

    yield Edit("channels", f"{topic} encoding", partial(changed, message_encoding="json"))
    yield Edit("channels", f"{topic} metadata", partial(changed, metadata={"more": "1"}))
    yield Edit("channels", f"{topic} without schema", partial(changed, schema_id=0))
    yield Edit("channels", f"{topic} renamed", renamed)
    yield Edit("channels", f"{topic} gone", gone)


def _schema(number: int, name: str) -> Iterator[Edit]:
    def changed(found: Content, **fields: Any) -> None:
        found.schemas[number] = replace(found.schemas[number], **fields)

    def text(found: Content) -> None:
        changed(found, data=found.schemas[number].data + b"\n# more")

    yield Edit("schemas", f"{name} text", text)
    yield Edit("schemas", f"{name} name", partial(changed, name=f"{name}2"))
    yield Edit("schemas", f"{name} encoding", partial(changed, encoding="ros1msg"))


def _metadata_key(kind: str, record: str, key: str) -> Iterator[Edit]:
    def other(found: Content) -> None:
        values = found.values(record)
        values[key] = "false" if values[key] == "true" else values[key] + "1"

    yield Edit(kind, f"{key}, another", other)
    yield Edit(kind, f"{key}, empty", lambda f: f.values(record).update({key: ""}))
    yield Edit(kind, f"{key}, removed", lambda f: f.values(record).pop(key))


def _records() -> Iterator[Edit]:
    def without(name: str, found: Content) -> None:
        found.metadata = [one for one in found.metadata if one[0] != name]

    def doubled(name: str, found: Content) -> None:
        found.metadata.append((name, dict(found.values(name))))

    def more(name: str, found: Content) -> None:
        found.values(name)["more"] = "1"

    for kind, name in {"origin": PROVENANCE, "end": END}.items():
        yield Edit(kind, "no record", partial(without, name))
        yield Edit(kind, "record doubled", partial(doubled, name))
        yield Edit(kind, "a key more", partial(more, name))
    note = lambda f: f.metadata.append(("note", {"verified": "yes"}))  # noqa: E731
    yield Edit("metadata", "a record more", note)
    late = lambda f: f.metadata.append(("late note", {"verified": "yes"}))  # noqa: E731
    yield Edit("metadata", "a record more at the end", late)


def set_mode(found: Content, mode: str, deep: bool) -> None:
    """Set another mode in the run's origin and, if ``deep``, in the nodes' parameters too."""
    found.values(PROVENANCE)["mode"] = mode
    if not deep:
        return
    for message in found.of(PARAMETERS):
        value = parsed(message)
        for parameter in value.new_parameters:
            if parameter.name == "lockstep.enabled":
                parameter.value.bool_value = mode == "lockstep"
        store(message, value)


def _modes(now: str) -> Iterator[Edit]:
    def edit(mode: str, deep: bool, more: Callable[[Content], object], found: Content) -> None:
        set_mode(found, mode, deep)
        more(found)
        renumber(found)

    def no_commands(found: Content) -> None:
        found.messages = [
            m for m in found.messages if m[0] != COMMANDS and not m[0].endswith("/state")
        ]

    def only_no_commands(found: Content) -> None:
        found.messages = [m for m in found.messages if m[0] != COMMANDS]

    def scaled(found: Content) -> None:
        for message in found.of(TRUTH):
            sample = sample_of(message)
            put(message, sample._replace(position=tuple(0.1 * v for v in sample.position)))

    def wall_clock(found: Content) -> None:
        for message in found.messages:
            message[LOG] = message[PUBLISH] = message[LOG] + 1_700_000_000_000_000_000

    def no_lifecycle(found: Content) -> None:
        words = {"configured", "ready"}
        found.messages = [
            m for m in found.messages if m[0] != EVENTS or parse_event(m[2]).message not in words
        ]

    def as_offline(found: Content) -> None:
        no_lifecycle(found)
        found.messages = [
            m
            for m in found.messages
            if m[0] != PARAMETERS or parse_parameter_event(m[2]).node != "/recorder"
        ]

    def in_simulated_time(found: Content) -> None:
        as_offline(found)
        for message in found.messages:
            sec, nanosec = (int.from_bytes(message[2][at:][:4], "little") for at in (4, 8))
            stamp_ns = 0 if sec > 2**31 else sec * 10**9 + nanosec
            message[LOG] = message[PUBLISH] = stamp_ns

    more: dict[str, Callable[[Content], object]] = {
        "alone": lambda _: None,
        "without commands and terms": no_commands,
        "without commands": only_no_commands,
        "truth times 0.1": scaled,
        "by a wall clock": wall_clock,
        "without lifecycle": no_lifecycle,
        "without recorder and lifecycle": as_offline,
        "without recorder and lifecycle, in simulated time": in_simulated_time,
    }
    for mode in (*_MODES, "", "other"):
        for deep in (False, True):
            for what, change in more.items():
                name = f"{mode!r}{', parameters too' if deep else ''}, {what}"
                if mode != now or what in ("without commands", "truth times 0.1"):
                    yield Edit("mode", name, partial(edit, mode, deep, change))


def _renamed(found: Content, new: Callable[[str], str], nodes: bool) -> None:
    found.channels = {
        new(topic): replace(channel, topic=new(topic)) for topic, channel in found.channels.items()
    }
    for message in found.messages:
        if nodes and message[0] == EVENTS:
            value = parsed(message)
            for status in value.status:
                status.name = new(status.name)
                for pair in status.values:
                    if pair.key.startswith("/"):
                        pair.key = new(pair.key)
            store(message, value)
        elif nodes and message[0] == PARAMETERS:
            value = parsed(message)
            value.node = new(value.node)
            store(message, value)
        message[0] = new(message[0])


def _topics() -> Iterator[Edit]:
    def other_controller(found: Content) -> None:
        _renamed(found, lambda name: name.replace("/pid", "/computed_torque"), False)

    def extra(topic: str, found: Content) -> None:
        found.channels[topic] = replace(found.channels[COMMANDS], topic=topic)
        found.messages += [[topic, *message[1:]] for message in found.of(COMMANDS)[:5]]

    def empty(found: Content) -> None:
        found.channels["/more"] = replace(found.channels[COMMANDS], topic="/more")

    def turned(found: Content) -> None:
        swap = {TRUTH: MEASURED, MEASURED: TRUTH}
        for message in found.messages:
            message[0] = swap.get(message[0], message[0])
        renumber(found)

    def exchanged(found: Content) -> None:
        a, b = "/fuzzy_pid/state", "/pid/state"
        swap = {a: b, b: a}
        for message in found.messages:
            message[0] = swap.get(message[0], message[0])
        renumber(found)

    def adjacent(found: Content) -> None:
        k = len(found.messages) // 2
        while found.messages[k][0] == found.messages[k + 1][0]:
            k += 1
        found.messages[k], found.messages[k + 1] = found.messages[k + 1], found.messages[k]

    def by_topic(found: Content) -> None:
        found.messages.sort(key=lambda message: message[0])

    in_place = lambda name: f"/robot{name}"  # noqa: E731
    yield Edit("topics", "all in a namespace", lambda f: _renamed(f, in_place, False))
    yield Edit("topics", "all in a namespace, nodes too", lambda f: _renamed(f, in_place, True))
    yield Edit("topics", "another controller's terms", other_controller)
    yield Edit("topics", "one more of no node", partial(extra, "/more"))
    yield Edit("topics", "one more of a controller", partial(extra, "/computed_torque/state"))
    yield Edit("topics", "references", partial(extra, "/other/reference"))
    yield Edit("topics", "one more without messages", empty)
    yield Edit("topics", "truth and measured exchanged", turned)
    yield Edit("topics", "terms of two controllers exchanged", exchanged)
    yield Edit("order across topics", "two neighbours swapped", adjacent)
    yield Edit("order across topics", "one topic after the other", by_topic)


def _runs() -> Iterator[Edit]:
    def second(topics: tuple[str, ...], found: Content) -> None:
        again = [list(message) for message in found.messages if message[0] in topics]
        found.messages += again
        renumber(found)

    def interleaved(found: Content) -> None:
        found.messages = [
            one for m in found.messages for one in ([m, list(m)] if m[0] in LOOP else [m])
        ]
        renumber(found)

    def shorter(found: Content) -> None:
        half = sample_of(at(found.of(TRUTH), "middle")).stamp_ns
        found.messages = [
            m for m in found.messages if m[0] not in LOOP or sample_of(m).stamp_ns <= half
        ]
        renumber(found)

    def shorter_and_said_so(found: Content) -> None:
        shorter(found)
        states = len(found.of(TRUTH))
        for message in found.of(EVENTS):
            value = parsed(message)
            for pair in value.status[0].values:
                if pair.key == "states":
                    pair.value = str(states)
                if pair.key.startswith("/"):
                    pair.value = str(len(found.of(pair.key)))
            store(message, value)

    loop = (TRUTH, MEASURED, COMMANDS, DISTURBANCE)
    yield Edit("a second run", "states again", partial(second, (TRUTH, MEASURED)))
    yield Edit("a second run", "truth again", partial(second, (TRUTH,)))
    yield Edit("a second run", "the loop again", partial(second, loop))
    yield Edit("a second run", "everything again", partial(second, (*LOOP, EVENTS, PARAMETERS)))
    yield Edit("a second run", "every message of the loop twice", interleaved)
    yield Edit("a shorter run", "half of it", shorter)
    yield Edit("a shorter run", "half of it, and counted so", shorter_and_said_so)
