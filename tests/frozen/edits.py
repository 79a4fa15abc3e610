"""All edits of tests/tampering with digests written anew: which are caught, and which change a number."""

from __future__ import annotations

import struct
from collections.abc import Collection, Hashable, Iterator
from functools import cache
from pathlib import Path

from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, Content, content

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_state_cdr import JointStateLayout
from trunk_msgs_util.recording.schemas import parse_event, parse_parameter_event

from ..tampering.bases import BASES, make_base
from ..tampering.check import _DURATION_S, Outcome, outcome
from ..tampering.edits import edits_of
from .caught import NUMBER, OTHER, PASSES, RAISES, Caught

_LETTERS = {0: PASSES, 1: "d", 2: "c"}  # by exit code
_LOOP = (
    topics.GROUND_TRUTH,
    topics.JOINT_STATES,
    topics.EFFORT_COMMAND,
    topics.DISTURBANCE,
    topics.OPERATOR_PUSH,
)
_ACTS = (Event.FELL, Event.RESET, Event.ACTIVATED, Event.DEACTIVATED)


def judged_edits(
    folder: Path, names: Collection[str] | None = None
) -> Iterator[tuple[str, Caught]]:
    """Make the recordings that are edited, and yield what becomes of each edit by its name.

    ``names``: only of these edits. What changes nothing in a recording is left out.
    """
    for base in BASES:
        if names is not None and not any(name.startswith(f"{base}: ") for name in names):
            continue
        path = folder / f"{base}.mcap"
        path.unlink(missing_ok=True)
        make_base(base, path, _DURATION_S[base])
        original = content(path)
        before = numbers_of(original)
        for edit in edits_of(original):
            name = f"{base}: {edit.kind}: {edit.name}"
            if names is None or name in names:
                result = outcome(base, original, edit, ANEW, folder)
                if result.exit_code is not None:
                    edited = original.copy()
                    edit.apply(edited)
                    yield name, _caught(result, numbers_of(edited) != before)


def _caught(result: Outcome, number: bool) -> Caught:
    letter = RAISES if result.raised else _LETTERS[result.exit_code or 0]
    mark = NUMBER if number else OTHER
    return Caught(mark, letter, result.reason if letter == PASSES else "")


def numbers_of(recorded: Content) -> frozenset[Hashable]:
    """Return the numbers of a run, each with its stamp and with what it is of.

    They are the values of the loop's joint states, all parameters, falls, resets and turns. What comes
    twice counts once; order, log times, other events and whatever cannot be read do not count.
    """
    suffix = f"/{topics.GROUND_TRUTH}"
    namespace = next(
        (topic.removesuffix(suffix) for topic in recorded.channels if topic.endswith(suffix)), ""
    )
    numbers: set[Hashable] = set()
    for topic, _, data, *_ in recorded.messages:
        relative = topic.removeprefix(f"{namespace}/")
        if relative in _LOOP or topics.is_controller_state(relative):
            numbers |= {(relative, values) for values in _joint_values(data)}
        elif relative == topics.RUN_PARAMETERS:
            numbers |= _parameters(data)
        elif relative == topics.RUN_EVENTS:
            numbers |= _acts(data)
    return frozenset(numbers)


@cache
def _joint_values(data: bytes) -> frozenset[Hashable]:
    """Return a message's stamp and the bits of all its values by joint, as one value; none if unreadable."""
    try:
        sample = JointStateLayout.parse(data).unpack(data)
    except (ValueError, struct.error):
        return frozenset()
    values = set()
    for quantity in ("position", "velocity", "effort"):
        given = getattr(sample, quantity)
        names = sample.name if len(sample.name) == len(given) else range(len(given))
        bits = (struct.pack("<d", value) for value in given)
        values |= {(quantity, name, bit) for name, bit in zip(names, bits, strict=True)}
    return frozenset([(sample.stamp_ns, frozenset(values))])


@cache
def _parameters(data: bytes) -> frozenset[Hashable]:
    try:
        event = parse_parameter_event(data)
    except ValueError:
        return frozenset()
    return frozenset(
        (_last(event.node), event.stamp_ns, first, name, repr(value))
        for first, values in ((True, event.new), (False, event.changed))
        for name, value in values.items()
    )


@cache
def _acts(data: bytes) -> frozenset[Hashable]:
    try:
        event = parse_event(data)
    except ValueError:
        return frozenset()
    act = _last(event.node), event.message, event.stamp_ns
    return frozenset([act] if event.message in _ACTS else [])


def _last(name: str) -> str:
    """Return a node's name without its namespace."""
    return name.rpartition("/")[2]
