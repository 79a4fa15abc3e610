"""Until when a run's messages can be attributed: one simulator, one controller at a time, none missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event, as_count
from trunk_msgs_util.recording.reader import RecordingError

from ..plans.nodes import CONTROLLERS
from ..recorded.turns import acting
from .consistency import uncounted
from .missing import counted, missed_from_ns, recorded_until_ns

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Integers

    from ..recorded.run import RecordedRun


SHARED = "two simulators or controllers, or one that was restarted: what follows t = {:g} s is not judged"

_LAST_WORDS = (Event.PUBLISHED, Event.FAILED)


def shared_from_ns(run: RecordedRun) -> int | None:
    """Return the first stamp at which the run may not have been alone; None if it always was.

    One simulator's stamps increase, and each state has one answer, by the same controller. Where that
    ends, a second simulator or controller publishes, or one was restarted: from there on no message can
    be attributed.
    """
    found: list[int] = []
    for relative in (topics.GROUND_TRUTH, topics.JOINT_STATES):
        stamps = run.table(relative).stamp_ns
        places = np.flatnonzero(np.diff(stamps) <= 0)
        if len(places):
            found.append(_before_fall(stamps, int(places[0])))
    # A file does not keep the order between publishers: of two controllers' commands too.
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    answers = np.sort(commands)
    found += answers[1:][np.diff(answers) == 0][:1].tolist()
    if (run.recording.end or {}).get("complete") != "true":
        truth = run.table(topics.GROUND_TRUTH).stamp_ns
        found += _of_a_stranger(commands, run.table(topics.JOINT_STATES).stamp_ns)
        if run.count(topics.DISTURBANCE) and "disturbance" in run.parameters:
            disturbances = run.table(topics.DISTURBANCE).stamp_ns
            falls = np.flatnonzero(np.diff(disturbances) < 0)
            found += [_before_fall(disturbances, int(place)) for place in falls[:1]]
            doubled = np.sort(disturbances)
            found += doubled[1:][np.diff(doubled) == 0][:1].tolist()
            ahead = truth + run.config("disturbance").period_ns
            found += _of_a_stranger(disturbances, np.concatenate([truth, ahead]))
        found += _of_another_hand(run)
    found += [*_replaced(run), *_started_anew(run), *_unheard(run), *_rivals(run)]
    return min(found, default=None)


def _before_fall(stamps: Integers, place: int) -> int:
    """Return the last stamp before time falls back after a place, ignoring a single stamp far ahead.

    What comes after the fall must not be mistaken for what came before it.
    """
    ahead = place > 0 and stamps[place + 1] > stamps[place - 1]
    before = stamps[: place + (0 if ahead else 1)].max()
    return int(min(before, stamps[place + 1 :].min()))


def _of_another_hand(run: RecordedRun) -> list[int]:
    """Return the first push's stamp if more pushes are recorded than the simulator says it took."""
    topic = run.recording.topic(topics.OPERATOR_PUSH)
    words = [event.values for event in run.events if event.message == Event.PUBLISHED]
    taken = sum(max(as_count(said.get(topic, "")), 0) for said in words)
    if not words or run.count(topics.OPERATOR_PUSH) <= taken:
        return []
    return [int(run.table(topics.OPERATOR_PUSH).stamp_ns.min())]


def _of_a_stranger(stamps: Integers, known: Integers) -> Iterator[int]:
    """Yield the last stamp before the first message that belongs to no state; else the first state's."""
    rows = np.flatnonzero(~np.isin(stamps, known))
    if len(rows):
        yield int(stamps[: rows[0]].max(initial=known.min(initial=0)))


def _replaced(run: RecordedRun) -> Iterator[int]:
    """Yield when a controller ended, by its last event, if another one took its place after that.

    A controller or disturbance node also cannot be told from a later one of the same name.
    """
    active: set[str] = set()
    ended: dict[str, int] = {}
    for event in run.events if run.mode != "offline" else ():
        node = run.recording.relative(event.node)
        controls = node in CONTROLLERS
        if not controls and node != "disturbance":
            continue
        if event.message in _LAST_WORDS:
            ended.setdefault(node, event.stamp_ns)
        elif event.message in (Event.CONFIGURED, Event.ACTIVATED):
            places = [
                at for one, at in ended.items() if one == node or (controls and one in active)
            ]
            if places:
                yield min(places)
                return
        if event.message == Event.ACTIVATED and controls:
            active.add(node)
        elif event.message in (Event.DEACTIVATED, Event.CLEANED_UP):
            active.discard(node)


def _rivals(run: RecordedRun) -> Iterator[int]:
    """Yield the first state at which two controllers were active by their own events."""
    if run.mode == "offline":
        return
    stamps = np.unique(run.table(topics.JOINT_STATES).stamp_ns)
    turns = _turns(run).values()
    active = sum((acting(stamps, some, False).astype(int) for some in turns), 0 * stamps)
    yield from stamps[active > 1][:1].tolist()


def _turns(run: RecordedRun) -> dict[str, list[tuple[int, bool]]]:
    """Return when each controller became active or inactive, by its own events."""
    turns: dict[str, list[tuple[int, bool]]] = {}
    for event in run.events:
        if run.recording.relative(event.node) in CONTROLLERS:
            told = turns.setdefault(event.node, [])
            if event.message == Event.ACTIVATED:
                told.append((event.stamp_ns, True))
            elif event.message in (*_LAST_WORDS, Event.DEACTIVATED, Event.CLEANED_UP):
                told.append((event.stamp_ns, False))
    return turns


def _started_anew(run: RecordedRun) -> Iterator[int]:
    """Yield 0 if a second process has the name of one without a last event: they cannot be told apart."""
    if run.mode == "offline":
        return
    processes: dict[str, str] = {}
    ended: Counter[str] = Counter()
    for event in run.events:
        if event.message in _LAST_WORDS:
            ended[event.node] += 1
            processes.pop(event.node, None)
        elif event.message == Event.CONFIGURED:
            process = event.values.get("process", "")
            if processes.setdefault(event.node, process) != process:
                yield 0
    # A process that was killed early may have published only its parameters.
    sets = Counter(change.node for change in run.recording.parameter_messages() if change.new)
    told = Counter(event.node for event in run.events if event.message == Event.CONFIGURED)
    cut = bool(told) and (run.recording.end or {}).get("complete") != "true"
    for node, count in sets.items():
        if count > min(1 + ended[node], max(told[node], 1)) or (cut and not told[node]):
            yield 0


def _unheard(run: RecordedRun) -> Iterator[int]:
    """Yield 0 if the plant was driven before the first command, and its controller joined the run under way.

    Another controller began the run, and was killed before the recorder received anything from it.
    """
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if run.mode == "offline" or not len(commands):
        return
    first = int(commands.min())
    joined = any(
        event.stamp_ns == first - 1 and run.recording.relative(event.node) in CONTROLLERS
        for event in run.events
        if event.message == Event.ACTIVATED
    )
    yield from _of_nobody(run)
    if first > 0 and joined:
        truth = run.table(topics.GROUND_TRUTH)
        if truth.values("effort")[truth.stamp_ns <= first, 1:].any():
            yield 0


def _of_nobody(run: RecordedRun) -> Iterator[int]:
    """Yield the first command that was given while no controller was active by the events.

    Its controller was killed before the recorder had received its events, and did not count its commands. In
    a complete file with all counts it is a contradiction.
    """
    complete = (run.recording.end or {}).get("complete") == "true"
    anew = any(event.message == Event.CLEANED_UP for event in run.events)
    if complete and not anew and not uncounted(run):
        return
    commands = np.unique(run.table(topics.EFFORT_COMMAND).stamp_ns)
    acted = [acting(commands, turns, False) for turns in _turns(run).values()]
    more = run.count(topics.EFFORT_COMMAND) > (counted(run, topics.EFFORT_COMMAND) or 0)
    if acted and more:  # without any events, another controller gave them
        yield from commands[~np.any(acted, axis=0)][:1].tolist()


def robot_obstacles(run: RecordedRun) -> list[str]:
    """Return why our commands to a robot cannot be recomputed."""
    found = []
    states = run.table(topics.JOINT_STATES).stamp_ns
    unknown = np.setdiff1d(run.table(topics.EFFORT_COMMAND).stamp_ns, states)
    if len(unknown):
        found.append(
            f"{len(unknown)} commands answer states that are not recorded: what followed from them is "
            "not known; start the recorder before the controller"
        )
    joints = sorted({run.config(name).joint for name in run.judgeable})
    if len(joints) > 1:
        found.append(f"our controllers command several joints: {', '.join(joints)}")
    if states.min(initial=0) < 0:
        found.append("states before t = 0: their order is not known")
    node, inactive = run.recording.topic("recorder"), False
    for event in run.events:
        inactive |= event.node == node and event.message == Event.DEACTIVATED
        if inactive and event.node == node and event.message == Event.ACTIVATED:
            found.append("the recorder was inactive for a while: what it missed is not known")
            break
    return found


def explicable_until_ns(run: RecordedRun) -> int | None:
    """Return the first stamp from which a command cannot be traced to its controller; None if all can be.

    Raises RecordingError where none can be.
    """
    found = [shared_from_ns(run)]
    if run.another_robot:
        for obstacle in robot_obstacles(run):
            raise RecordingError(f"{run.path}: {obstacle}")
    elif "simulator" in run.parameters:
        recorded_ns = recorded_until_ns(run)
        found += [missed_from_ns(run), None if recorded_ns is None else recorded_ns + 1]
    return min((one for one in found if one is not None), default=None)
