"""All edits of a recording: of messages' fields, of their number and order, and of the file around them."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial, reduce
from math import inf, nan, nextafter
from typing import Any, NamedTuple

import numpy as np
from ros2_ws.src.trunk_recording.test.mcap_files import Content, stamp_of
from ros2_ws.src.trunk_recording.test.test_events import CARRIES

from trunk_core.parameters.declarations import Declaration, declarations
from trunk_core.topics import DIAGNOSTIC_ARRAY_TYPE, JOINT_STATE_TYPE, PARAMETER_EVENT_TYPE, Event
from trunk_core.units import NANOSECONDS
from trunk_recording import schemas
from trunk_recording.schemas import parse_event, parse_parameter_event
from trunk_recording.writer import END, PROVENANCE
from trunk_runs.nodes import NODES

TRUTH, MEASURED, COMMANDS = "/ground_truth/joint_states", "/joint_states", "/effort_command"
DISTURBANCE, EVENTS, PARAMETERS = "/disturbance", "/run/events", "/run/parameters"
INPUTS = "/plant/inputs"  # in real time
STATES = ("/fuzzy_pid/state", "/pid/state")
LOOP = (TRUTH, MEASURED, COMMANDS, DISTURBANCE, *STATES)
TYPES = {EVENTS: DIAGNOSTIC_ARRAY_TYPE, PARAMETERS: PARAMETER_EVENT_TYPE}  # others: JointState
TOPIC, LOG, DATA, PUBLISH, SEQUENCE = range(5)  # places in a message of `Content`
QUANTITIES = "position velocity effort"

Message = list[Any]
Pick = Callable[[list[Message]], Sequence[Message]]
Step = Callable[[Content, Sequence[Message]], object]
Alter = Callable[[Any], Any]  # of a message as a tree, or of a part of one


class Edit(NamedTuple):
    """A change of a recording's content; ``kind`` groups edits in the report."""

    kind: str
    name: str
    apply: Callable[[Content], object]


def edits_of(recorded: Content) -> Iterator[Edit]:
    """Yield every edit of a recording that there is."""
    stamps = [stamp_ns(tree(message)) for message in recorded.of(TRUTH)]
    for topic in (*LOOP, INPUTS):
        for message in recorded.of(topic)[:1]:
            yield from _joint_edits(topic, tree(message), stamps[1])
    seen = set()
    for number, message in enumerate(recorded.of(EVENTS)):
        event = parse_event(message[DATA])
        if (event.node, event.message) not in seen:
            seen.add((event.node, event.message))
            name = f"{event.node} {event.message}"
            yield from _event_edits(name, number, list(event.values), stamps[1])
    yield from _edits_of_events(stamps)
    for number, message in enumerate(recorded.of(PARAMETERS)):
        yield from _parameter_edits(number, parse_parameter_event(message[DATA]), stamps[1])
    yield from _file_edits(recorded)


# Which messages, and what is done to them.


def on(topic: str, pick: Pick, *steps: Step) -> Callable[[Content], object]:
    """Return a change of some of a topic's messages."""

    def apply(recorded: Content) -> None:
        messages = pick(recorded.of(topic))
        for step in steps:
            step(recorded, messages)

    return apply


def every(messages: list[Message]) -> list[Message]:
    return messages


def nth(number: int) -> Pick:
    return lambda messages: [messages[number]]


PLACES: dict[str, Pick] = {
    "first": nth(0),
    "middle": lambda messages: [messages[round((len(messages) - 1) / 2)]],
    "last": nth(-1),
}


def tree(message: Message) -> Any:
    """Return a message as what rosbags makes of it."""
    return schemas.deserialize(TYPES.get(message[TOPIC], JOINT_STATE_TYPE), message[DATA])


def stamp_ns(value: Any) -> int:
    return stamp_of(getattr(value, "header", value).stamp)


def each(change: Callable[[Message], object]) -> Step:
    return lambda _, messages: [change(message) for message in messages]


def heads(places: Sequence[int], by: int) -> Step:
    """Add to times or sequence numbers of messages."""
    return each(lambda m: [m.__setitem__(place, m[place] + by) for place in places])


def fields(alter: Alter, log_time: bool = True) -> Step:
    """Alter messages; in simulated time, the log time goes with the stamp unless it is to stay."""

    def change(message: Message) -> None:
        value = tree(message)
        altered = alter(value)
        if log_time and message[LOG] == max(stamp_ns(value), 0):
            message[LOG] = message[PUBLISH] = max(stamp_ns(altered), 0)
        message[DATA] = schemas.serialize(value.__msgtype__, altered)

    return each(change)


def at(paths: str, change: Alter) -> Alter:
    """Return a change of the parts at some paths, such as ``position.1`` or ``status.*.name``."""

    def changed(part: Any, path: str) -> Any:
        key, _, rest = path.partition(".")
        if not key:
            return change(part)
        if key == "*":
            return [changed(item, rest) for item in part]
        part = copy(part)
        if key.isdigit():
            part[int(key)] = changed(part[int(key)], rest)
        else:
            setattr(part, key, changed(getattr(part, key), rest))
        return part

    return lambda value: reduce(changed, paths.split(), value)


def to(value: Any) -> Alter:
    return lambda _: value


def without(number: int) -> Callable[[list[Any]], list[Any]]:
    return lambda items: [*items[:number], *items[number + 1 :]]


def stamped(by_ns: int) -> Alter:
    """Move the stamp; it comes to lie before the run at the earliest."""

    def moved(stamp: Any) -> Any:
        sec, nanosec = divmod(max(stamp_of(stamp) + by_ns, -1), NANOSECONDS)
        return replace(stamp, sec=sec, nanosec=nanosec)

    return lambda value: at("header.stamp" if hasattr(value, "header") else "stamp", moved)(value)


def dropped(recorded: Content, messages: Sequence[Message]) -> None:
    gone = {id(message) for message in messages}
    recorded.messages = [message for message in recorded.messages if id(message) not in gone]


def doubled(recorded: Content, messages: Sequence[Message]) -> None:
    recorded.messages += [list(message) for message in messages]


def doubled_at_once(recorded: Content, messages: Sequence[Message]) -> None:
    twice = {id(message) for message in messages}
    recorded.messages = [
        each
        for message in recorded.messages
        for each in ([message, list(message)] if id(message) in twice else [message])
    ]


def to_the_beginning(recorded: Content, messages: Sequence[Message]) -> None:
    dropped(recorded, messages)
    recorded.messages[:0] = messages


def to_the_end(recorded: Content, messages: Sequence[Message]) -> None:
    dropped(recorded, messages)
    recorded.messages += messages


def backwards(_: Content, messages: Sequence[Message]) -> None:
    contents = [message[1:] for message in messages[::-1]]
    for message, content in zip(messages, contents, strict=True):
        message[1:] = content


def values_exchanged(recorded: Content, messages: Sequence[Message]) -> None:
    stamps = [tree(message).header.stamp for message in messages]
    backwards(recorded, messages)
    for message, stamp in zip(messages, stamps, strict=True):
        fields(at("header.stamp", to(stamp)))(recorded, [message])


def renumbered(recorded: Content, _: Sequence[Message] = ()) -> None:
    """Give every topic's messages consecutive sequence numbers, as the recorder does."""
    counts: Counter[str] = Counter()
    for message in recorded.messages:
        message[SEQUENCE] = counts[message[TOPIC]]
        counts[message[TOPIC]] += 1


# The topics of the loop.

# What is done to a number; each changes its bits.
_NUMBERS: Mapping[str, Callable[[float], float]] = {
    "one ULP": lambda v: nextafter(v, inf),
    "times 1.1": lambda v: v * 1.1 if v else 0.1,
    "sign": lambda v: -v,
    "NaN": to(nan),
    "infinite": to(inf),
    "+ 0.25": lambda v: v + 0.25,  # a part of a ns, of an age
    "to -77": to(-77.0),
}


def _quantity(value: Any, full: bool) -> str:
    """Return the name of the first quantity that has values, or has none."""
    return next((q for q in QUANTITIES.split() if (len(getattr(value, q)) > 0) == full), "")


def _longer(part: Any) -> Any:
    return [*part, "other"] if isinstance(part, list) else np.append(part, part[-1:])


_JOINT_STATES: dict[str, Alter] = {
    "names turned": at("name", lambda names: names[::-1]),
    "names and values turned": at(f"name {QUANTITIES}", lambda part: copy(part[::-1])),
    "a name changed": at("name.0", to("other")),
    "a quantity more": lambda v: at(_quantity(v, False), to(np.zeros(len(v.name))))(v),
    "a joint more": at(f"name {QUANTITIES}", _longer),
    "a quantity less": lambda v: at(_quantity(v, True), to(np.zeros(0)))(v),
    "times 0.1": at(QUANTITIES, lambda values: 0.1 * values),
    "other sign": at(QUANTITIES, lambda values: -values),
}
_FRAMES: dict[str, Alter] = {"frame_id": to("map"), "a word more": lambda frame: f"{frame} more"}
_HEADS: tuple[tuple[str, Pick, str, tuple[int, ...], int], ...] = (
    ("log times", PLACES["middle"], "one log time + 1 ns", (LOG,), 1),
    ("log times", PLACES["middle"], "one log time + 1 s", (LOG,), NANOSECONDS),
    ("log times", PLACES["middle"], "one publish time + 1 ns", (PUBLISH,), 1),
    ("log times", every, "all log and publish times + 1 s", (LOG, PUBLISH), NANOSECONDS),
    ("log times", every, "all publish times + 1 s", (PUBLISH,), NANOSECONDS),
    ("sequence", PLACES["middle"], "one sequence + 1", (SEQUENCE,), 1),
    ("sequence", every, "all sequences + 1", (SEQUENCE,), 1),
)
_BYTES: dict[str, Callable[[bytes], bytes]] = {
    "with a tail": lambda data: data + b"tail",
    "cut short": lambda data: data[:-4],
    "said to be big-endian": lambda data: b"\0\0" + data[2:],
}
_SEQUENCES: tuple[tuple[str, str, Pick, Step], ...] = (
    *(("messages", f"{place} dropped", pick, dropped) for place, pick in PLACES.items()),
    *(("messages", f"{p} doubled next to it", pick, doubled_at_once) for p, pick in PLACES.items()),
    *(("messages", f"{p} doubled at the end", pick, doubled) for p, pick in PLACES.items()),
    ("messages", "cut at half time", lambda m: m[len(m) // 2 :], dropped),
    ("messages", "the first half gone", lambda m: m[: len(m) // 2], dropped),
    ("messages", "only the first 10", lambda m: m[10:], dropped),
    ("messages", "every second one", lambda m: m[1::2], dropped),
    ("messages", "none", every, dropped),
    # Of one controller: far from a swap.
    ("order", "two swapped", lambda m: m[len(m) // 4 :][:2], backwards),
    ("order", "two with each other's values", lambda m: m[len(m) // 2 :][:2], values_exchanged),
    ("order", "backwards", every, backwards),
    ("order", "the last one first", PLACES["last"], to_the_beginning),
    ("order", "after all others", every, to_the_end),
)


def _joint_edits(topic: str, sample: Any, period: int) -> Iterator[Edit]:
    for quantity in QUANTITIES.split():
        for index in range(len(getattr(sample, quantity))):
            for place, pick in PLACES.items():
                for what, change in _NUMBERS.items():
                    if place == "middle" or what == "one ULP":
                        name = f"{topic} {quantity}[{index}] {place} {what}"
                        step = fields(at(f"{quantity}.{index}", change))
                        yield Edit("one value", name, on(topic, pick, step))
    for which, pick in {"one": PLACES["middle"], "all": every}.items():
        for what, alter in _JOINT_STATES.items():
            name = f"{topic} {which} {what}"
            yield Edit("names and quantities", name, on(topic, pick, fields(alter)))
        for what, change in _FRAMES.items():
            framed = fields(at("header.frame_id", change))
            yield Edit("frame", f"{topic} {which} {what}", on(topic, pick, framed))
    for which, pick in {**PLACES, "all": every}.items():
        for what, by_ns in {"1 ns": 1, "a period": period, "a day": 86_400 * NANOSECONDS}.items():
            name = f"{topic} {which} stamp{'s' * (which == 'all')} + {what}"
            yield Edit("stamps", name, on(topic, pick, fields(stamped(by_ns))))
    for kind, pick, what, places, by in _HEADS:
        yield Edit(kind, f"{topic} {what}", on(topic, pick, heads(places, by)))
    for what, change in _BYTES.items():
        step = each(lambda m, change=change: m.__setitem__(DATA, change(m[DATA])))
        edit = on(topic, PLACES["middle"], step)
        yield Edit("bytes", f"{topic} one message {what}", edit)
    for kind, what, pick, step in _SEQUENCES:
        yield Edit(kind, f"{topic} {what}", on(topic, pick, step, renumbered))


# Events and parameters.


def _stamps(period: int) -> dict[str, Step]:
    by = {"+ 1 ns": 1, "+ a period": period, "- a period": -period, "+ 1 s": NANOSECONDS}
    return {what: fields(stamped(ns)) for what, ns in {**by, "to -1 ns": -(2**60)}.items()}


_ONE_MORE = {
    f"{what} + 1": heads((place,), 1)
    for what, place in {"log time": LOG, "publish time": PUBLISH, "sequence": SEQUENCE}.items()
}


def _other_node(node: str) -> str:
    return "/pid" if node != "/pid" else "/fuzzy_pid"


_MORE = schemas.build("diagnostic_msgs/msg/KeyValue", key="more", value="1")
_EVENTS: dict[str, Alter] = {
    "a value more": at("status.0.values", lambda pairs: [*pairs, _MORE]),
    "of another node": at("status.0.name", _other_node),
    "of an unknown node": at("status.0.name", to("/other")),
    "another level": at("status.0.level", lambda level: level + 1),
    "another word": at("status.0.message", to("happened")),
    "a second status": at("status", lambda statuses: statuses * 2),
    "no status": at("status", to([])),
    "another hardware_id": at("status.0.hardware_id", to("robot")),
    "a frame_id": at("header.frame_id", to("map")),
}
_EVENT_SEQUENCES: tuple[tuple[str, str, Step], ...] = (
    ("event removed", "", dropped),
    ("event doubled", ", at the end", doubled),
    ("event doubled", ", at once", doubled_at_once),
    ("event moved", ", to the beginning", to_the_beginning),
    ("event moved", ", to the end", to_the_end),
)


def _event_edits(what: str, number: int, keys: list[str], period: int) -> Iterator[Edit]:
    on_it = partial(on, EVENTS, nth(number))
    for kind, where, step in _EVENT_SEQUENCES:
        yield Edit(kind, f"{what}{where}", on_it(step, renumbered))
    for by, step in _stamps(period).items():
        yield Edit("event stamped", f"{what} {by}", on_it(step))
    for name, step in _ONE_MORE.items():
        yield Edit("event's head", f"{what}, {name}", on_it(step))
    for i, key in enumerate(keys):
        other = at(f"status.0.values.{i}.value", lambda v: v[:-1] + "12"[v[-1:] == "1"])
        yield Edit("event's values", f"{what}, another {key}", on_it(fields(other)))
        less = at("status.0.values", without(i))
        yield Edit("event's values", f"{what}, without {key}", on_it(fields(less)))
    for name, alter in _EVENTS.items():
        yield Edit("event's content", f"{what}, {name}", on_it(fields(alter)))


_NODES = ("recorder", "fuzzy_pid", "pid", "disturbance", "simulator")
_CARRIED = {"rate": "500.0", "angle": "0.1", "limit": "0.5", "reason": "finished",
            "answers": "effort_command", "process": "boot.1.1", "link.state": "1 sent",
            "link.command": "1 sent", "sensor.dropout": "1", "disturbances": "9", "commanded": "1",
            "silent": "0", "node": "/mine", "middleware": "Cyclone DDS",
            "what": "commands not finite", "why": "the effort is nan"}  # fmt: skip


def _edits_of_events(stamps: list[int]) -> Iterator[Edit]:
    """Yield edits that remove all events of a kind, or put in one that no node sent."""

    def of(node: str, word: str, messages: list[Message]) -> list[Message]:
        events = ((message, parse_event(message[DATA])) for message in messages)
        return [m for m, e in events if node in ("", e.node) and word in ("", e.message)]

    def add(node: str, word: Event, row: int, recorded: Content) -> None:
        values = {**_CARRIED, "kind": node, "states": str(len(stamps))}
        carried = {key: values[key] for key in CARRIES[word]}
        truth = recorded.of(TRUTH)[row]
        where = next(i for i, m in enumerate(recorded.messages) if m is truth)
        event = schemas.event(stamps[row], f"/{node}", word, carried)
        recorded.messages.insert(where + 1, [EVENTS, truth[LOG], event, truth[LOG], 0])
        renumbered(recorded)

    gone = {"all": every, **{f"all of {node}": partial(of, f"/{node}", "") for node in _NODES}}
    for name, pick in {**gone, **{f"all {word}": partial(of, "", word) for word in Event}}.items():
        yield Edit("events", f"{name} removed", on(EVENTS, pick, dropped, renumbered))
    for node in _NODES:
        for word in Event:
            for place, row in {"half way": len(stamps) // 2, "at the end": len(stamps) - 1}.items():
                yield Edit("event added", f"{node} {word} {place}", partial(add, node, word, row))


# By number of a parameter's type: its field, and another type.
_FIELDS = {1: ("bool_value", 2), 2: ("integer_value", 3), 3: ("double_value", 2),
           4: ("string_value", 9), 7: ("integer_array_value", 8), 8: ("double_array_value", 9),
           9: ("string_array_value", 4)}  # fmt: skip
_SETS = {
    name: fields(alter)
    for name, alter in {
        "order of parameters": at("new_parameters changed_parameters", lambda listed: listed[::-1]),
        "in the other list": lambda v: at("changed_parameters", to(v.new_parameters))(
            at("new_parameters", to(v.changed_parameters))(v)
        ),
        "of another node": at("node", _other_node),
        "of an unknown node": at("node", to("/other")),
        "one deleted too": lambda v: at(
            "deleted_parameters",
            lambda names: names + (v.new_parameters or v.changed_parameters)[:1],
        )(v),
    }.items()
}


def _parameter_edits(number: int, event: Any, period: int) -> Iterator[Edit]:
    on_it = partial(on, PARAMETERS, nth(number))
    node, how = event.node.strip("/"), "changed" if event.changed else "set"
    listed = "new_parameters" if event.new else "changed_parameters"
    kind, what = "parameters' message", f"{node}, {how}"
    for name, step in {"removed": dropped, "doubled": doubled, "to the end": to_the_end}.items():
        yield Edit(kind, f"{what}, {name}", on_it(step, renumbered))
    stamps = {f"stamp {by}": step for by, step in _stamps(period).items()}
    for name, step in {**stamps, **_ONE_MORE, **_SETS}.items():
        yield Edit(kind, f"{what}, {name}", on_it(step))
    for i, name in enumerate(event.new or event.changed):
        declared = declarations(NODES[node].config)[name]
        path, what = f"{listed}.{i}", f"{node}.{name}, {how}"

        changes: dict[str, Alter] = {
            "removed": at(listed, without(i)),
            "renamed": at(f"{path}.name", lambda name: name + "_"),
            "doubled": at(listed, lambda items, i=i: [*items, items[i]]),
            "another type": at(f"{path}.value.type", lambda number: _FIELDS[number][1]),
            "not set": at(f"{path}.value.type", to(0)),
        }
        if declared.kind != "string":
            smuggled = at(f"{path}.value.string_value", lambda text: text + "x")
            changes["a value of another type besides"] = smuggled
        for name, alter in changes.items():
            yield Edit(f"parameter {name}", what, on_it(fields(alter)))
        for which in range(3):
            step = fields(at(f"{path}.value", partial(_another, declared, which)))
            yield Edit("parameter", f"{what}, another value ({which})", on_it(step))


def _another(declared: Declaration, which: int, value: Any) -> Any:
    field, _ = _FIELDS[value.type]
    others = list(_others(declared, getattr(value, field)))
    return at(field, to(others[which]))(value) if which < len(others) else value


def _others(declared: Declaration, value: Any) -> Iterator[Any]:
    """Yield up to three other values of a parameter that may be allowed: near, far, simple."""
    kind = declared.kind
    if declared.choices and kind == "string":
        yield from [choice for choice in declared.choices if choice != value][:3]
    elif kind == "bool":
        yield not value
    elif kind == "integer":
        yield from (value + 1, value * 3 + 2)
    elif kind == "double" and abs(value) == inf:
        yield from (np.copysign(1e-3, value), np.copysign(1e6, value))
    elif kind == "double":
        yield from (value * 1.5, value * 0.1) if value else (1e-2, -1e-2)
    elif kind == "string":
        yield value + "x"
    elif kind == "string array":
        items = list(value)
        yield [*items, items[0] if items else "other"]
        if items:
            yield items[:-1]
            yield [" ".join(reversed(items[0].split())) if " " in items[0] else "other", *items[1:]]
    else:
        yield np.full(len(value) + 1, 0.1).astype(value.dtype)
        if len(value):
            yield value * 1.5
            yield value[:-1]


# The file around the messages.

_HEADER = {
    "profile": ("profile", to("ros1")),
    "library": ("library", to("some recorder")),
    "no library": ("library", to("")),
    "library's version": ("library", lambda library: library + "1"),
}
_CHANNELS = {
    "encoding": ("message_encoding", to("json")),
    "metadata": ("metadata", to({"more": "1"})),
    "without schema": ("schema_id", to(0)),
}


def _swapped(text: bytes) -> bytes:
    """Return a definition in which other readers take positions for velocities."""
    parts = text.split(b"position")
    return b"velocity".join(part.replace(b"velocity", b"position") for part in parts)


_SCHEMAS = {
    "text": ("data", lambda data: data + b"\n# more"),
    "fields": ("data", _swapped),
    "name": ("name", lambda name: name + "2"),
    "encoding": ("encoding", to("ros1msg")),
}
_VALUES: dict[str, Callable[[str], dict[str, str]]] = {
    "another": lambda value: "false" if value == "true" else value + "1",
    "empty": to(""),
    "removed": to(None),
}


def _file_edits(recorded: Content) -> Iterator[Edit]:
    def described(kind: str, key: Any, path: str, change: Alter, f: Content) -> None:
        getattr(f, kind)[key] = at(path, change)(getattr(f, kind)[key])

    def put(record: str, key: str, change: Alter, f: Content) -> None:
        values = f.values(record)
        values[key] = change(values[key])
        if values[key] is None:
            del values[key]

    for name, (path, change) in _HEADER.items():
        yield Edit("header", name, lambda f, p=path, c=change: setattr(f, p, c(getattr(f, p))))
    attach = ("note.txt", b"trust me")
    yield Edit("attachments", "one more", lambda f: f.attachments.append(attach))
    for kind, names, table in (
        ("channels", {topic: topic for topic in recorded.channels}, _CHANNELS),
        ("schemas", {n: schema.name for n, schema in recorded.schemas.items()}, _SCHEMAS),
    ):
        for key, name in names.items():
            for what, row in table.items():
                yield Edit(kind, f"{name} {what}", partial(described, kind, key, *row))
    for topic in recorded.channels:
        longer = partial(renamed, lambda name, topic=topic: f"{topic}_" if name == topic else name)
        yield Edit("channels", f"{topic} renamed", longer)
        gone = on(topic, every, dropped, lambda f, _, topic=topic: f.channels.pop(topic))
        yield Edit("channels", f"{topic} gone", gone)
    for kind, record in {"origin": PROVENANCE, "end": END}.items():
        for key in recorded.values(record):
            for name, change in _VALUES.items():
                yield Edit(kind, f"{key}, {name}", partial(put, record, key, change))
        one = (record, dict(recorded.values(record)))
        yield Edit(kind, "no record", lambda f, one=one: f.metadata.remove(one))
        yield Edit(kind, "record doubled", lambda f, one=one: f.metadata.append(one))
        other = (record, {key: f"{value}1" for key, value in one[1].items()})
        yield Edit(kind, "another record besides", lambda f, o=other: f.metadata.append(o))
        yield Edit(kind, "a key more", lambda f, r=record: f.values(r).update(more="1"))
    for name, record in {"": "note", " at the end": "late note"}.items():
        note = (record, {"verified": "yes"})
        yield Edit("metadata", f"a record more{name}", lambda f, note=note: f.metadata.append(note))
    yield from _modes(recorded.values(PROVENANCE)["mode"])
    yield from _topics()
    yield from _runs()


def _modes(now: str) -> Iterator[Edit]:
    def wall_clock(recorded: Content) -> None:
        heads((LOG, PUBLISH), 1_700_000_000 * NANOSECONDS)(recorded, recorded.messages)

    def of_nodes(message: Message) -> bool:
        words = {"configured", "ready"}
        return message[TOPIC] == EVENTS and parse_event(message[DATA]).message in words

    def of_recorder(message: Message) -> bool:
        node = message[TOPIC] == PARAMETERS and parse_parameter_event(message[DATA]).node
        return of_nodes(message) or node == "/recorder"

    def without(which: Callable[[Message], bool], recorded: Content) -> None:
        recorded.messages = [message for message in recorded.messages if not which(message)]

    def in_simulated_time(recorded: Content) -> None:
        without(of_recorder, recorded)
        for message in recorded.messages:
            message[LOG] = message[PUBLISH] = max(stamp_ns(tree(message)), 0)

    more: dict[str, Callable[[Content], object]] = {
        "alone": lambda _: None,
        "without commands and terms": partial(
            without, lambda m: m[TOPIC] == COMMANDS or m[TOPIC].endswith("/state")
        ),
        "without commands": on(COMMANDS, every, dropped),
        "truth times 0.1": on(TRUTH, every, fields(at("position", lambda v: 0.1 * v))),
        "by a wall clock": wall_clock,
        "without lifecycle": partial(without, of_nodes),
        "without recorder and lifecycle": partial(without, of_recorder),
        "without recorder and lifecycle, in simulated time": in_simulated_time,
    }

    def edit(mode: str, deep: bool, change: Callable[[Content], object], f: Content) -> None:
        def told(parameter: Any) -> Any:
            if parameter.name != "lockstep.enabled":
                return parameter
            return at("value.bool_value", to(mode == "lockstep"))(parameter)

        f.values(PROVENANCE)["mode"] = mode
        if deep:
            on(PARAMETERS, every, fields(at("new_parameters.*", told)))(f)
        change(f)
        renumbered(f)

    for mode in ("offline", "lockstep", "real_time", "", "other"):
        for deep in (False, True):
            for what, change in more.items():
                name = f"{mode!r}{', parameters too' if deep else ''}, {what}"
                if mode != now or what in ("without commands", "truth times 0.1"):
                    yield Edit("mode", name, partial(edit, mode, deep, change))


def renamed(new: Callable[[str], str], recorded: Content, nodes: bool = False) -> None:
    """Give topics other names, and if ``nodes`` the nodes, too, wherever they are named."""
    recorded.channels = {
        new(name): replace(channel, topic=new(name)) for name, channel in recorded.channels.items()
    }

    def pair(item: Any) -> Any:
        return replace(item, key=new(item.key)) if item.key.startswith("/") else item

    if nodes:
        named, values = at("status.0.name", new), at("status.0.values.*", pair)
        on(EVENTS, every, fields(named), fields(values))(recorded)
        on(PARAMETERS, every, fields(at("node", new)))(recorded)
    for message in recorded.messages:
        message[TOPIC] = new(message[TOPIC])


def _topics() -> Iterator[Edit]:
    def exchanged(a: str, b: str, recorded: Content) -> None:
        for message in recorded.messages:
            message[TOPIC] = {a: b, b: a}.get(message[TOPIC], message[TOPIC])
        renumbered(recorded)

    def extra(topic: str, count: int, recorded: Content) -> None:
        recorded.channels[topic] = replace(recorded.channels[COMMANDS], topic=topic)
        recorded.messages += [[topic, *message[1:]] for message in recorded.of(COMMANDS)[:count]]

    def adjacent(recorded: Content) -> None:
        messages = recorded.messages
        k = len(messages) // 2
        while messages[k][TOPIC] == messages[k + 1][TOPIC]:
            k += 1
        messages[k : k + 2] = messages[k + 1], messages[k]

    for name, edit in {
        "all in a namespace": partial(renamed, "/robot{}".format),
        "all in a namespace, nodes too": partial(renamed, "/robot{}".format, nodes=True),
        "another controller's terms": partial(
            renamed, lambda name: name.replace("/pid", "/computed_torque")
        ),
        "one more of no node": partial(extra, "/more", 5),
        "one more of a controller": partial(extra, "/computed_torque/state", 5),
        "references": partial(extra, "/other/reference", 5),
        "one more without messages": partial(extra, "/more", 0),
        "truth and measured exchanged": partial(exchanged, TRUTH, MEASURED),
        "terms of two controllers exchanged": partial(exchanged, *STATES),
    }.items():
        yield Edit("topics", name, edit)
    yield Edit("order across topics", "two neighbours swapped", adjacent)
    by_topic = lambda f: f.messages.sort(key=lambda message: message[TOPIC])  # noqa: E731
    yield Edit("order across topics", "one topic after the other", by_topic)


def _runs() -> Iterator[Edit]:
    def again(topics: tuple[str, ...], step: Step, recorded: Content) -> None:
        step(recorded, [message for message in recorded.messages if message[TOPIC] in topics])
        renumbered(recorded)

    def shorter(recorded: Content) -> None:
        half = stamp_ns(tree(*PLACES["middle"](recorded.of(TRUTH))))
        later = [m for m in recorded.messages if m[TOPIC] in LOOP and stamp_ns(tree(m)) > half]
        dropped(recorded, later)
        renumbered(recorded)

    def shorter_and_said_so(recorded: Content) -> None:
        shorter(recorded)

        def counted(pair: Any) -> Any:
            topic = {"states": TRUTH}.get(pair.key, pair.key)
            count = str(len(recorded.of(topic)))
            return replace(pair, value=count) if topic.startswith("/") else pair

        on(EVENTS, every, fields(at("status.0.values.*", counted)))(recorded)

    loop = (TRUTH, MEASURED, COMMANDS, DISTURBANCE)
    for name, topics, step in (
        ("states again", (TRUTH, MEASURED), doubled),
        ("truth again", (TRUTH,), doubled),
        ("the loop again", loop, doubled),
        ("everything again", (*LOOP, EVENTS, PARAMETERS), doubled),
        ("every message of the loop twice", LOOP, doubled_at_once),
    ):
        yield Edit("a second run", name, partial(again, topics, step))
    yield Edit("a shorter run", "half of it", shorter)
    yield Edit("a shorter run", "half of it, and counted so", shorter_and_said_so)
