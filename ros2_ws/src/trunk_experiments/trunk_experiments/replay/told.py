"""Whether the nodes can have published what is on ``run/events`` and ``run/parameters``.

Every node goes through ROS 2's lifecycle, says only what its kind can say, and stamps it with the last state
that it processed. An event that was added, removed, moved or attributed to another node breaks this.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from trunk_msgs_util import topics
from trunk_msgs_util.events import ENDS, Event
from trunk_msgs_util.recording.schemas import LEVEL_ERROR, LEVEL_OK, LEVEL_WARN, RunEvent
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS, NODES
from .as_told import PUBLISHES, not_as_told

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun

_OF_ALL = {Event.CONFIGURED, Event.ACTIVATED, Event.DEACTIVATED, Event.CLEANED_UP,
           Event.RETUNED, Event.FAILED}  # fmt: skip
_OF_SIMULATOR = {Event.STARTED, Event.RESET, Event.PAUSED, Event.RESUMED, Event.FELL,
                 Event.PASSED_ON, Event.PUBLISHED, *ENDS}  # fmt: skip
_SAYS = {
    "simulator": _OF_ALL | _OF_SIMULATOR,
    "disturbance": _OF_ALL | {Event.READY, Event.PUBLISHED},
    "recorder": (_OF_ALL | {Event.READY}) - {Event.RETUNED},  # all its parameters are fixed
    **dict.fromkeys(CONTROLLERS, _OF_ALL | {Event.READY, Event.RESET, Event.PUBLISHED}),
}
_ANSWERS = {
    "disturbance": topics.DISTURBANCE,
    "recorder": "recorder",
    **dict.fromkeys(CONTROLLERS, topics.EFFORT_COMMAND),
}
_LEVELS = {Event.FELL: LEVEL_WARN, Event.FAILED: LEVEL_ERROR}
# (Lifecycle state, event): the state that follows; other events need a configured node.
_UNCONFIGURED, _INACTIVE, _ACTIVE = "unconfigured", "inactive", "active"
_TURNS: dict[tuple[str, str], str] = {
    (_UNCONFIGURED, Event.CONFIGURED): _INACTIVE,
    (_INACTIVE, Event.ACTIVATED): _ACTIVE,
    (_ACTIVE, Event.DEACTIVATED): _INACTIVE,
    (_INACTIVE, Event.CLEANED_UP): _UNCONFIGURED,
}
_TRANSITIONS = {event for _, event in _TURNS}
_FROM_OUTSIDE = {Event.RETUNED, Event.RESET, Event.ACTIVATED, Event.DEACTIVATED}
_ANYWHERE = {Event.RETUNED, Event.FAILED, Event.PUBLISHED}


def untellable(run: RecordedRun) -> list[str]:
    """Return what such nodes cannot publish, a line each. Raises ParameterError for wrong parameters."""
    by_node: dict[str, list[RunEvent]] = {}
    for event in run.events:
        by_node.setdefault(run.recording.relative(event.node), []).append(event)
    found: list[str] = []
    for node, told in by_node.items():
        if node not in NODES or node not in run.parameters:
            found.append(
                f"run/events: {told[0].message!r} of {node}, whose parameters are not recorded"
            )
            continue
        found += [line for event in told for line in _content(run, node, event)]
        found += _stamps(run, node, told)
        if run.mode == "offline":
            found += _offline(node, told)
        else:
            found += _lifecycle(run, node, told)
        found += not_as_told(run, node, told)
    if run.mode != "offline":
        found += [
            f"run/events: {node} was never configured"
            for node in run.parameters
            if node in NODES and node not in by_node
        ]
    return found


def _content(run: RecordedRun, node: str, event: RunEvent) -> Iterator[str]:
    """Yield what an event of this kind of node cannot contain."""
    what = f"run/events: {event.message!r} of {node} at t = {seconds(event.stamp_ns):g} s"
    words = {str(word): word for word in Event}
    word = words.get(event.message)
    if word is None or word not in _SAYS[node]:
        yield f"{what}: no such event"
        return
    if event.level != _LEVELS.get(word, LEVEL_OK):
        yield f"{what}: level {event.level}"
    keys = tuple(event.values)
    if word == Event.PUBLISHED:
        own = {run.recording.topic(relative) for relative in PUBLISHES[node]}
        if not keys or not set(keys) <= own:
            yield f"{what}: it counts {', '.join(keys) or 'nothing'}"
    elif word == Event.FAILED:
        if not keys or keys[0] != "reason":
            yield f"{what}: it gives {', '.join(keys) or 'no reason'}"
    elif keys != word.carries:
        yield f"{what}: it gives {', '.join(keys) or 'nothing'}, not {', '.join(word.carries) or 'nothing'}"
        return
    if word == Event.CONFIGURED and event.values["kind"] != node:
        yield f"{what}: it says that it is {event.values['kind'] or 'nothing'}"
    if word == Event.READY and event.values["answers"] != _ANSWERS[node]:
        yield f"{what}: it answers on {event.values['answers']}"
    if word == Event.FELL:
        timeline = run.timeline(node)
        timeline.advance(event.stamp_ns)
        if event.values["limit"] != str(timeline.config.fall_angle):
            yield f"{what}: limit {event.values['limit']}, by the parameters {timeline.config.fall_angle}"


def _stamps(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield stamps that belong to no state, or that go backwards in a graph."""
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    period = run.config("simulator").period_ns
    last = int(truth.max()) + (period if node == "disturbance" else 0) if len(truth) else -1
    before = -1
    for event in told:
        at, what = event.stamp_ns, f"run/events: {event.message!r} of {node}"
        # A controller that joins a run under way begins just before the first state that it sees.
        joins = node in CONTROLLERS and (at + 1) % period == 0
        if at != -1 and at % period and not joins:
            yield f"{what} at t = {at} ns, where there is no state"
        # What an offline run was to do after its end has no effect.
        never = run.mode == "offline" and event.message in _FROM_OUTSIDE
        if at < -1 or (at > last and not never):
            yield f"{what} at t = {seconds(at):g} s, outside the run"
        if run.mode != "offline":
            if event.message == Event.CONFIGURED:
                before = min(before, at)
            if at < before:
                yield f"{what} at t = {seconds(at):g} s, after one at t = {seconds(before):g} s"
            before = max(before, at)


def _lifecycle(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield events that a node in a graph cannot send in its lifecycle state."""
    state, ready, begun = _UNCONFIGURED, False, False
    configured = activated = False
    scheduled = node in CONTROLLERS and bool(run.config(node).active_times)
    period = run.config("simulator").period_ns
    for event in told:
        what = f"run/events: {event.message!r} of {node} at t = {seconds(event.stamp_ns):g} s"
        if event.message in _TRANSITIONS:
            joins = (
                node in CONTROLLERS
                and event.message == Event.ACTIVATED
                and state == _ACTIVE
                and not begun
                and event.stamp_ns > 0
                and (event.stamp_ns + 1) % period == 0
            )
            after = state if joins else _TURNS.get((state, event.message))
            if after is None:
                yield f"{what}, which was {state}"
            state = after or state
            if event.message == Event.CONFIGURED:
                ready, begun, configured = False, False, True
            activated = activated or event.message == Event.ACTIVATED
        elif event.message not in _ANYWHERE and state == _UNCONFIGURED:
            yield f"{what}, which was not configured"
        if not configured and event.stamp_ns != -1:
            yield f"{what}, before it was configured"
        if event.message == Event.READY:
            if ready:
                yield f"{what}: it was ready before"
            if not activated and not scheduled:
                yield f"{what}, before it was active"
            ready = True
        if event.message == Event.STARTED and (state != _ACTIVE or event.stamp_ns != -1):
            yield f"{what}: a run is started before its first state, by an active simulator"
        begun = begun or event.stamp_ns >= 0
    if not activated and (node == "recorder" or run.count(PUBLISHES[node][0])):
        yield f"run/events: {node} was never active"


def _offline(node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield events that only nodes of a graph send, and turns without effect."""
    for event in told:
        if event.message in {Event.READY, Event.PUBLISHED, Event.PAUSED, Event.RESUMED,
                             Event.CONFIGURED}:  # fmt: skip
            yield f"run/events: {event.message!r} of {node} in an offline run"
        if event.message in _TRANSITIONS and node not in CONTROLLERS:
            yield f"run/events: {event.message!r} of {node} in an offline run"
        if event.message == Event.STARTED and event.stamp_ns != -1:
            yield f"run/events: started at t = {seconds(event.stamp_ns):g} s"
