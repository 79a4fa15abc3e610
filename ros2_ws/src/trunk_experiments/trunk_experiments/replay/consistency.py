"""Compare what a complete recording says of itself in two places.

A digest shows that a file is as it was written. These checks also catch a file that was rewritten together
with its digests, if its parts no longer agree. Each returns one line for each contradiction.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from trunk_control.laws import law_named
from trunk_msgs_util import topics
from trunk_msgs_util.events import ENDS, Event, as_count
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS
from ..recorded.turns import idle_ns
from .by_hand import not_by_hand

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Integers
    from trunk_msgs_util.recording.schemas import RunEvent

    from ..recorded.run import RecordedRun

_JOINTS = ("position", "velocity", "effort")
_MODES = {"real_time": False, "lockstep": True}  # is lockstep.enabled set?


def contradictions(run: RecordedRun) -> list[str]:
    """Return the contradictions in a run that is recorded as complete.

    Raises RecordingError for messages that cannot be read, ParameterError for parameters.
    """
    return [
        *_names(run),
        *_ends(run),
        *_counts(run),
        *_falls(run),
        *_mode(run),
        *_times(run),
        *_terms(run),
        *not_by_hand(run),
    ]


def _names(run: RecordedRun) -> Iterator[str]:
    """Yield where messages name other joints than the parameters, or hold other quantities."""
    simulator = run.config("simulator")
    expected: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
        (topics.GROUND_TRUTH, simulator.joints, _JOINTS),
        (topics.JOINT_STATES, simulator.joints, _JOINTS),
        (topics.DISTURBANCE, simulator.joints, ("position", "effort")),
        (topics.OPERATOR_PUSH, simulator.joints, ("effort",)),
    ]
    known = [name for name in run.controllers if name in CONTROLLERS]
    joints = sorted({run.config(name).joint for name in known})
    expected += [(topics.EFFORT_COMMAND, (joint,), ("effort",)) for joint in joints[:1]]
    expected += [
        (topics.controller_state(name), law_named(name).record_names, ("position",))
        for name in known
    ]
    for relative, names, quantities in expected:
        table = run.table(relative)
        if not len(table):
            continue
        if table.names != names:
            yield (
                f"{relative} names {', '.join(table.names) or 'nothing'}; "
                f"by the parameters it must be {', '.join(names)}"
            )
        for quantity in _JOINTS:
            width = table.widths[quantity]
            wanted = len(table.names) if quantity in quantities else 0
            if width != wanted:
                yield f"{relative}: {width} values of {quantity} in a message, a node writes {wanted}"
    if len(joints) > 1:
        yield f"the controllers command different joints: {', '.join(joints)}"


def _ends(run: RecordedRun) -> Iterator[str]:
    """Yield where the run does not begin once and end once, or goes on after its end."""
    simulator = run.recording.topic("simulator")
    told = [event for event in run.events if event.node == simulator]
    for word, count in Counter(event.message for event in told).items():
        if word == Event.STARTED and count > 1:
            yield f"run/events: the simulator started {count} times"
    rate = run.config("simulator").update_rate
    started = [event for event in told if event.message == Event.STARTED]
    if not started:
        yield "run/events: the simulator never started"
    for event in started[:1]:
        if event.values.get("rate") != str(rate):
            yield f"run/events: started at {event.values.get('rate')} Hz, by the parameters {rate} Hz"
    ends = [place for place, event in enumerate(told) if event.message in ENDS]
    if not ends or told[ends[0]].message != Event.FINISHED:
        how = f"ended as {told[ends[0]].message!s}" if ends else "did not end"
        yield f"marked as complete, but by run/events the run {how}"
        return
    if len(ends) > 1:
        yield f"run/events: the run ends {len(ends)} times: {', '.join(told[i].message for i in ends)}"
    reason = told[ends[0]].values.get("reason", "")
    marked = (run.recording.end or {}).get("reason", "")
    if reason != marked:
        yield f"run/events: the run ended as {reason!r}, the recorder noted {marked!r}"
    # A finished simulator reports only its counts and the end of its lifecycle.
    after = {Event.PUBLISHED, Event.DEACTIVATED, Event.CLEANED_UP, Event.PAUSED}
    late = [e.message for e in told[ends[0] + 1 :] if e.message not in {*after, *ENDS}]
    if late:
        yield f"run/events: the simulator goes on after its end: {', '.join(late)}"


def _counts(run: RecordedRun) -> Iterator[str]:
    """Yield where the number of recorded messages is not the number that the nodes say they published."""
    finished = _of(run, "simulator", Event.FINISHED)
    if finished:
        said = finished[-1].values.get("states", "")
        relatives = [topics.GROUND_TRUTH, topics.JOINT_STATES]
        relatives += [topics.EFFORT_COMMAND] if run.exact else []
        for relative in relatives:
            idle = len(idle_ns(run)) if relative == topics.EFFORT_COMMAND else 0
            if str(run.count(relative) + idle) != said:
                yield f"{relative}: {run.count(relative)} messages, but the run had {said} states"
    anew = any(event.message == Event.CLEANED_UP for event in run.events)
    claimed: Counter[str] = Counter()
    for event in run.events:
        if event.message == Event.PUBLISHED:
            for topic, count in event.values.items():
                claimed[topic] += as_count(count)
    silent = uncounted(run)  # may have published on a topic that another node counted
    for topic, published in claimed.items():
        if silent and topic == run.recording.topic(topics.EFFORT_COMMAND):
            continue
        there = run.recording.topics.get(topic)
        found = there.count if there else 0
        # A node that was cleaned up counts anew; what it had published before is not in its count.
        more = anew and found > published
        if found != published and not more:
            yield f"{topic}: {found} messages, but {published} were published by the nodes' own count"


def _falls(run: RecordedRun) -> Iterator[str]:
    """Yield falls whose angle is not that of their state."""
    truth = run.table(topics.GROUND_TRUTH)
    for event in _of(run, "simulator", Event.FELL):
        if event.stamp_ns not in truth:
            yield f"run/events: a fall at t = {seconds(event.stamp_ns):g} s, where no state is recorded"
            continue
        angle = truth.get(event.stamp_ns, "position")[-1]
        if event.values.get("angle") != str(angle):
            yield (
                f"run/events: fell at t = {seconds(event.stamp_ns):g} s with angle "
                f"{event.values.get('angle')}, the state's is {angle}"
            )


def _mode(run: RecordedRun) -> Iterator[str]:
    """Yield where mode and controllers of the run's origin are not those of its nodes."""
    if run.mode in _MODES:
        nodes = ["simulator", *(name for name in run.controllers if name in CONTROLLERS)]
        for node in nodes:
            if run.config(node).lockstep != _MODES[run.mode]:
                yield f"mode {run.mode}, but {node} has lockstep.enabled = {run.config(node).lockstep}"
        if not _of(run, "simulator", Event.CONFIGURED):
            yield f"mode {run.mode}, but no simulator node was configured"
    elif run.mode == "offline":
        if any(event.message == Event.CONFIGURED for event in run.events):
            yield "mode offline, but nodes were configured"
    else:
        yield f"mode {run.mode!r}: the modes are real_time, lockstep and offline"
    planned = run.recording.provenance.get("controller", "").split()
    known = {*planned, *(run.joined if planned else run.controllers)}
    if not set(run.controllers) <= known:
        yield (
            f"recorded with {', '.join(run.controllers)}, but the run's origin names "
            f"{', '.join(planned)}"
        )


def _times(run: RecordedRun) -> Iterator[str]:
    """Yield where log times differ from the stamps in simulated time, or equal them in real time."""
    for relative in (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND):
        table = run.table(relative)
        if not len(table):
            continue
        equal = table.log_time_ns == np.maximum(table.stamp_ns, 0)
        if run.exact and not equal.all():
            at = seconds(int(table.stamp_ns[np.flatnonzero(~equal)[0]]))
            yield f"{relative}: mode {run.mode}, but at t = {at:g} s the log time is not the stamp"
        if not run.exact and len(table) > 1 and equal.all():
            yield f"{relative}: mode {run.mode}, but the log times are simulated time"


def _terms(run: RecordedRun) -> Iterator[str]:
    """Yield records of a law's terms, and disturbances, that belong to no state."""
    commands = run.table(topics.EFFORT_COMMAND)
    for name in run.controllers:
        relative = topics.controller_state(name)
        table = run.table(relative)
        yield from _once(relative, table.stamp_ns)
        alone = np.setdiff1d(table.stamp_ns, commands.stamp_ns)
        if len(alone):
            yield (
                f"{relative}: {len(alone)} records without a command, the first at "
                f"t = {seconds(int(alone[0])):g} s"
            )
    for name in run.controllers:
        # Each publisher's commands stay in order, whatever comes between them.
        told = np.isin(commands.stamp_ns, run.table(topics.controller_state(name)).stamp_ns)
        if run.mode == "offline":
            told[:] = True
        yield from _once(topics.EFFORT_COMMAND, commands.stamp_ns[told])
    if run.count(topics.DISTURBANCE):
        yield from _disturbances(run)


def _disturbances(run: RecordedRun) -> Iterator[str]:
    """Yield disturbances that belong neither to a state nor to the next one, and a missing last one."""
    stamps = run.table(topics.DISTURBANCE).stamp_ns
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    period = run.config("disturbance").period_ns
    if not len(truth):
        return
    if _ends_early(run) and not _missing_words(run, ["disturbance"]):
        yield f"{topics.DISTURBANCE}: none for the step after the last state"
    odd = np.setdiff1d(stamps, np.concatenate([truth, truth + period]))
    if len(odd):
        yield (
            f"{topics.DISTURBANCE}: {len(odd)} messages for no state of the run, the first at "
            f"t = {seconds(int(odd[0])):g} s"
        )


def _once(relative: str, stamps: Integers) -> Iterator[str]:
    steps = np.flatnonzero(np.diff(stamps) <= 0)
    if len(steps):
        at = seconds(int(stamps[steps[0] + 1]))
        yield f"{relative}: the record at t = {at:g} s is doubled or out of order"


def _ends_early(run: RecordedRun) -> bool:
    """Return True if an exact run has disturbances, but none for the step after the last state."""
    stamps, truth = (run.table(t).stamp_ns for t in (topics.DISTURBANCE, topics.GROUND_TRUTH))
    if not (run.exact and len(stamps) and len(truth)):
        return False
    return truth[-1] + run.config("disturbance").period_ns not in stamps


def _missing_words(run: RecordedRun, nodes: Sequence[str]) -> list[str]:
    """Return which of the nodes did not say how much they published: they were killed."""
    told = {event.node for event in run.events if event.message == Event.PUBLISHED}
    return [node for node in nodes if run.recording.topic(node) not in told]


def uncounted(run: RecordedRun) -> list[str]:
    """Return the nodes without a count of messages, where the run's states do not imply the number."""
    disturbed = ["disturbance"] if run.count(topics.DISTURBANCE) else []
    if run.exact:
        wanted = disturbed if _ends_early(run) else []
    else:
        wanted = ["simulator", *(n for n in run.controllers if n in CONTROLLERS), *disturbed]
    return without_a_count(_missing_words(run, wanted))


def without_a_count(nodes: Sequence[str]) -> list[str]:
    """Return a line for each of some nodes that did not say how much they published."""
    return [
        f"{name} did not say how many messages it published: whether all of them are here is not known"
        for name in nodes
    ]


def killed(run: RecordedRun) -> list[str]:
    """Return the controllers without a last word: their last commands may be missing."""
    return _missing_words(run, [name for name in run.controllers if name in CONTROLLERS])


def _of(run: RecordedRun, node: str, message: Event) -> list[RunEvent]:
    name = run.recording.topic(node)
    return [event for event in run.events if event.node == name and event.message == message]


def failures(events: Sequence[RunEvent], simulator: str) -> list[str]:
    """Return the failures that nodes other than the simulator reported."""
    return [
        f"{event.node} failed: {event.values.get('reason', 'no reason given')}"
        for event in events
        if event.message == Event.FAILED and event.node != simulator
    ]
