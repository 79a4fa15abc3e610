"""Edits of the topics of the loop: values, stamps, names, order, how many messages there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from ros2_ws.src.trunk_msgs_util.test.mcap_files import Content

from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import NANOSECONDS

from .messages import (
    DATA,
    LOG,
    NUMBERS,
    PUBLISH,
    SEQUENCE,
    Edit,
    put,
    renumber,
    sample_of,
    with_field,
)

TRUTH, MEASURED, COMMANDS = "/ground_truth/joint_states", "/joint_states", "/effort_command"
DISTURBANCE = "/disturbance"
STATES = ("/fuzzy_pid/state", "/pid/state")
LOOP = (TRUTH, MEASURED, COMMANDS, DISTURBANCE, *STATES)
QUANTITIES = ("position", "velocity", "effort")
_PLACES = {"first": 0, "middle": 0.5, "last": 1}


def joint_edits(found: Content) -> Iterator[Edit]:
    """Yield all edits of the loop's topics."""
    period = sample_of(found.of(TRUTH)[1]).stamp_ns
    for topic in LOOP:
        messages = found.of(topic)
        sample = sample_of(messages[0])
        for quantity in QUANTITIES:
            for index in range(len(getattr(sample, quantity))):
                yield from _values(topic, quantity, index)
        yield from _single(topic, period)
        yield from _whole(topic, period)
        yield from _count(topic)


def at(messages: Sequence[list[Any]], place: str) -> list[Any]:
    """Return the first, a middle or the last message."""
    return messages[round(_PLACES[place] * (len(messages) - 1))]


def _values(topic: str, quantity: str, index: int) -> Iterator[Edit]:
    def edit(place: str, change: Callable[[float], float], found: Content) -> None:
        message = at(found.of(topic), place)
        sample = sample_of(message)
        value = change(getattr(sample, quantity)[index])
        put(message, with_field(sample, quantity, index, value))

    for place in _PLACES:
        for what, change in NUMBERS.items():
            if place == "middle" or what == "one ULP":
                name = f"{topic} {quantity}[{index}] {place} {what}"
                yield Edit("one value", name, partial(edit, place, change))


def _turned_names(sample: JointSample) -> JointSample:
    return sample._replace(name=sample.name[::-1])


def _turned_all(sample: JointSample) -> JointSample:
    return JointSample(sample.stamp_ns, *(part[::-1] for part in sample[1:]))


def _other_name(sample: JointSample) -> JointSample:
    return sample._replace(name=("other", *sample.name[1:]))


def _more_values(sample: JointSample) -> JointSample:
    empty = next((q for q in QUANTITIES if not getattr(sample, q)), None)
    return sample._replace(**({empty: (0.0,) * len(sample.name)} if empty else {}))


def _more_joints(sample: JointSample) -> JointSample:
    more = [part + part[-1:] for part in sample[2:]]
    return JointSample(sample.stamp_ns, (*sample.name, "other"), *more)


def _fewer_values(sample: JointSample) -> JointSample:
    full = next(q for q in QUANTITIES if getattr(sample, q))
    return sample._replace(**{full: ()})


def _scaled(factor: float, sample: JointSample) -> JointSample:
    return JointSample(
        sample.stamp_ns, sample.name, *(tuple(factor * v for v in part) for part in sample[2:])
    )


_SAMPLES: dict[str, Callable[[JointSample], JointSample]] = {
    "names turned": _turned_names,
    "names and values turned": _turned_all,
    "a name changed": _other_name,
    "a quantity more": _more_values,
    "a joint more": _more_joints,
    "a quantity less": _fewer_values,
    "times 0.1": partial(_scaled, 0.1),
    "other sign": partial(_scaled, -1.0),
}


def _single(topic: str, period: int) -> Iterator[Edit]:
    """Yield edits of one message."""

    def sampled(change: Callable[[JointSample], JointSample], found: Content) -> None:
        message = at(found.of(topic), "middle")
        put(message, change(sample_of(message)))

    def moved(place: str, by_ns: int, found: Content) -> None:
        message = at(found.of(topic), place)
        sample = sample_of(message)
        put(message, sample._replace(stamp_ns=sample.stamp_ns + by_ns))

    def framed(found: Content) -> None:
        message = at(found.of(topic), "middle")
        put(message, sample_of(message), frame_id="map")

    def added(place: int, by: int, found: Content) -> None:
        message = at(found.of(topic), "middle")
        message[place] += by

    def tail(found: Content) -> None:
        message = at(found.of(topic), "middle")
        message[DATA] += b"tail"

    def cut(found: Content) -> None:
        message = at(found.of(topic), "middle")
        message[DATA] = message[DATA][:-4]

    def turned_bytes(found: Content) -> None:
        message = at(found.of(topic), "middle")
        message[DATA] = b"\x00\x00" + message[DATA][2:]

    for what, change in _SAMPLES.items():
        yield Edit("names and quantities", f"{topic} one {what}", partial(sampled, change))
    for what, by_ns in {"1 ns": 1, "a period": period, "a day": 86_400 * NANOSECONDS}.items():
        for place in _PLACES:
            yield Edit("stamps", f"{topic} {place} stamp + {what}", partial(moved, place, by_ns))
    yield Edit("frame", f"{topic} one frame_id", framed)
    yield Edit("log times", f"{topic} one log time + 1 ns", partial(added, LOG, 1))
    yield Edit("log times", f"{topic} one log time + 1 s", partial(added, LOG, NANOSECONDS))
    yield Edit("log times", f"{topic} one publish time + 1 ns", partial(added, PUBLISH, 1))
    yield Edit("sequence", f"{topic} one sequence + 1", partial(added, SEQUENCE, 1))
    yield Edit("bytes", f"{topic} one message with a tail", tail)
    yield Edit("bytes", f"{topic} one message cut short", cut)
    yield Edit("bytes", f"{topic} one message said to be big-endian", turned_bytes)


def _whole(topic: str, period: int) -> Iterator[Edit]:
    """Yield edits of every message."""

    def sampled(change: Callable[[JointSample], JointSample], found: Content) -> None:
        for message in found.of(topic):
            put(message, change(sample_of(message)))

    def framed(found: Content) -> None:
        for message in found.of(topic):
            put(message, sample_of(message), frame_id="map")

    def added(places: Sequence[int], by: int, found: Content) -> None:
        for message in found.of(topic):
            for place in places:
                message[place] += by

    def shifted(by_ns: int, sample: JointSample) -> JointSample:
        return sample._replace(stamp_ns=sample.stamp_ns + by_ns)

    for what, change in _SAMPLES.items():
        yield Edit("names and quantities", f"{topic} all {what}", partial(sampled, change))
    for what, by_ns in {"1 ns": 1, "a period": period}.items():
        edit = partial(sampled, partial(shifted, by_ns))
        yield Edit("stamps", f"{topic} all stamps + {what}", edit)
    yield Edit("frame", f"{topic} all frame_id", framed)
    second = partial(added, (LOG, PUBLISH), NANOSECONDS)
    yield Edit("log times", f"{topic} all log and publish times + 1 s", second)
    yield Edit("log times", f"{topic} all publish times + 1 s", partial(added, (PUBLISH,), 10**9))
    yield Edit("sequence", f"{topic} all sequences + 1", partial(added, (SEQUENCE,), 1))


def _count(topic: str) -> Iterator[Edit]:
    """Yield edits of how many messages there are, and of their order."""

    def edit(change: Callable[[Content, list[list[Any]]], None], found: Content) -> None:
        change(found, found.of(topic))
        renumber(found)

    def keep(choose: Callable[[list[list[Any]]], Sequence[list[Any]]]) -> Any:
        def change(found: Content, messages: list[list[Any]]) -> None:
            kept = {id(message) for message in choose(messages)}
            found.messages = [m for m in found.messages if m[0] != topic or id(m) in kept]

        return change

    def doubled(place: str, next_to_it: bool, found: Content, messages: list[list[Any]]) -> None:
        message = at(messages, place)
        where = next(i for i, m in enumerate(found.messages) if m is message)
        found.messages.insert(where + 1 if next_to_it else len(found.messages), list(message))

    def swapped(found: Content, messages: list[list[Any]]) -> None:
        a, b = messages[len(messages) // 4 :][:2]  # of one controller: far from a swap
        a[1:], b[1:] = b[1:], a[1:]

    def swapped_values(found: Content, messages: list[list[Any]]) -> None:
        a, b = messages[len(messages) // 2 :][:2]
        one, other = sample_of(a), sample_of(b)
        put(a, other._replace(stamp_ns=one.stamp_ns))
        put(b, one._replace(stamp_ns=other.stamp_ns))

    def backwards(found: Content, messages: list[list[Any]]) -> None:
        contents = [message[1:] for message in messages[::-1]]
        for message, content in zip(messages, contents, strict=True):
            message[1:] = content

    def last_first(found: Content, messages: list[list[Any]]) -> None:
        found.messages.remove(messages[-1])
        found.messages.insert(0, messages[-1])

    def to_the_end(found: Content, messages: list[list[Any]]) -> None:
        found.messages = [m for m in found.messages if m[0] != topic] + messages

    for place in _PLACES:
        drop = keep(lambda m, place=place: [one for one in m if one is not at(m, place)])
        yield Edit("messages", f"{topic} {place} dropped", partial(edit, drop))
        for near in (True, False):
            where = "next to it" if near else "at the end"
            yield Edit(
                "messages",
                f"{topic} {place} doubled {where}",
                partial(edit, partial(doubled, place, near)),
            )
    for what, choose in {
        "cut at half time": lambda m: m[: len(m) // 2],
        "the first half gone": lambda m: m[len(m) // 2 :],
        "only the first 10": lambda m: m[:10],
        "every second one": lambda m: m[::2],
        "none": lambda m: [],
    }.items():
        yield Edit("messages", f"{topic} {what}", partial(edit, keep(choose)))
    yield Edit("order", f"{topic} two swapped", partial(edit, swapped))
    yield Edit("order", f"{topic} two with each other's values", partial(edit, swapped_values))
    yield Edit("order", f"{topic} backwards", partial(edit, backwards))
    yield Edit("order", f"{topic} the last one first", partial(edit, last_first))
    yield Edit("order", f"{topic} after all others", partial(edit, to_the_end))
