"""Whether what the nodes tell on ``run/events`` and ``run/parameters`` is what such nodes can tell.

Every node goes through ROS 2's lifecycle, says only what its kind can say, and stamps it with the last state
that it processed. An event that was added, removed, moved or put in another node's mouth breaks this.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from trunk_control.schedule import active_at
from trunk_msgs_util import topics
from trunk_msgs_util.events import ENDS, Event
from trunk_msgs_util.parameters.declarations import declarations
from trunk_msgs_util.recording.schemas import LEVEL_ERROR, LEVEL_OK, LEVEL_WARN, RunEvent
from trunk_msgs_util.units import seconds, step_count

from ..plans.nodes import CONTROLLERS, NODES
from ..plans.timeline import begins_active

if TYPE_CHECKING:
    from trunk_sim.config import SimulatorConfig

    from ..recorded.run import RecordedRun

_OF_ALL = {Event.CONFIGURED, Event.ACTIVATED, Event.DEACTIVATED, Event.CLEANED_UP,
           Event.RETUNED, Event.FAILED}  # fmt: skip
_OF_SIMULATOR = {Event.STARTED, Event.RESET, Event.PAUSED, Event.RESUMED, Event.FELL,
                 Event.PUBLISHED, *ENDS}  # fmt: skip
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
# From which state of its lifecycle each event leads to which; others need a configured node.
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
_PUBLISHES = {
    "simulator": (topics.GROUND_TRUTH, topics.JOINT_STATES),
    "disturbance": (topics.DISTURBANCE,),
    **{name: (topics.controller_state(name), topics.EFFORT_COMMAND) for name in CONTROLLERS},
}


def untellable(run: RecordedRun) -> list[str]:
    """Return what no such nodes tell, a line each. Raises ParameterError for parameters."""
    by_node: dict[str, list[RunEvent]] = {}
    for event in run.events:
        by_node.setdefault(event.node.removeprefix(run.recording.topic("")), []).append(event)
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
        if node in CONTROLLERS:
            found += _acting(run, node, told)
        if node == "simulator":
            found += _pauses(run, told)
            found += _still(run, node, told, topics.GROUND_TRUTH)
        if node == "disturbance":
            found += _still(run, node, told, topics.DISTURBANCE)
        found += _counted(run, node, told)
    if run.mode != "offline":
        found += [
            f"run/events: {node} was never configured"
            for node in run.parameters
            if node in NODES and node not in by_node
        ]
    return [*found, *_end(run), *_rates(run), *_parameters(run), *_origin(run)]


def _content(run: RecordedRun, node: str, event: RunEvent) -> Iterator[str]:
    """Yield what an event of this kind of node does not say."""
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
        own = {run.recording.topic(relative) for relative in _PUBLISHES[node]}
        if not keys or not set(keys) <= own:
            yield f"{what}: it counts {', '.join(keys) or 'nothing'}"
    elif word == Event.FAILED:
        if not keys or keys[0] != "reason":
            yield f"{what}: it gives {', '.join(keys) or 'no reason'}"
    elif keys != word.carries:
        yield f"{what}: it gives {', '.join(keys) or 'nothing'}, not {', '.join(word.carries) or 'nothing'}"
        return
    if word == Event.READY and event.values["answers"] != _ANSWERS[node]:
        yield f"{what}: it answers on {event.values['answers']}"
    if word == Event.FELL:
        timeline = run.timeline(node)
        timeline.advance(event.stamp_ns)
        if event.values["limit"] != str(timeline.config.fall_angle):
            yield f"{what}: limit {event.values['limit']}, by the parameters {timeline.config.fall_angle}"


def _stamps(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield stamps that are those of no state, or that go backwards in a graph."""
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
            yield f"{what} at t = {seconds(at):g} s, outside of the run"
        if run.mode != "offline":
            if event.message == Event.CONFIGURED:
                before = min(before, at)
            if at < before:
                yield f"{what} at t = {seconds(at):g} s, after one at t = {seconds(before):g} s"
            before = max(before, at)


def _lifecycle(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield what a node in a graph cannot have said in its state."""
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
    if not activated and (node == "recorder" or run.count(_PUBLISHES[node][0])):
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


def _acting(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield where a controller gave commands while it was inactive by its own events."""
    stamps = np.sort(run.table(topics.controller_state(node)).stamp_ns)
    turns = [e for e in told if e.message in (Event.ACTIVATED, Event.DEACTIVATED)]
    config = run.config(node)
    if run.mode == "offline":
        turns.sort(key=lambda event: event.stamp_ns)  # those from outside come first in the file
    acting = np.zeros(len(stamps), bool)
    since: int | None = None
    if run.mode == "offline" and begins_active(config, run.changes(node)):
        since = -1  # and nothing says so
    for event in turns:
        active = event.message == Event.ACTIVATED
        if run.mode == "offline" and active == (since is not None):
            yield (
                f"run/events: {event.message!r} of {node} at t = {seconds(event.stamp_ns):g} s, "
                "which it was already"
            )
        if active:
            since = event.stamp_ns
        elif since is not None:
            acting |= (stamps > since) & (stamps <= event.stamp_ns)
            since = None
    if since is not None:
        acting |= stamps > since
    if not acting.all():
        at = seconds(int(stamps[np.flatnonzero(~acting)[0]]))
        yield f"{node}: an update at t = {at:g} s, although it was inactive by run/events"
    yield from _schedule(run, node, turns)


def _schedule(run: RecordedRun, node: str, turns: list[RunEvent]) -> Iterator[str]:
    """Yield scheduled turns that the events do not have, where every state was answered."""
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    times = run.config(node).active_times_ns
    if not run.exact or not len(truth):
        return
    for time_ns in times:
        later = truth[truth >= time_ns]
        if not len(later):
            continue
        first = int(later[0])
        past = [event for event in turns if event.stamp_ns < first]
        active = bool(past) and past[-1].message == Event.ACTIVATED
        if active != active_at(times, first):  # two turns may fall between two states
            word = "inactive" if active else "active"
            yield f"run/events: {node} was to become {word} at t = {seconds(time_ns):g} s and did not"


def _pauses(run: RecordedRun, told: list[RunEvent]) -> Iterator[str]:
    """Yield a pause in a pause, an end of none, and one in which simulated time goes on."""
    since: int | None = None
    for event in told:
        if event.message not in (Event.PAUSED, Event.RESUMED):
            continue
        what = f"run/events: {event.message!r} at t = {seconds(event.stamp_ns):g} s"
        if (since is None) != (event.message == Event.PAUSED):
            yield f"{what} twice"
        elif since not in (None, event.stamp_ns):
            yield f"{what}, after a pause at t = {seconds(since or 0):g} s"
        since = event.stamp_ns if event.message == Event.PAUSED else None
    last = run.table(topics.GROUND_TRUTH).stamp_ns.max(initial=-1)
    if since is not None and last > since:
        yield f"run/events: paused at t = {seconds(since):g} s and not resumed, but states go on"


def _still(run: RecordedRun, node: str, told: list[RunEvent], relative: str) -> Iterator[str]:
    """Yield where a node went on although it was inactive."""
    since: int | None = None
    for event in told:
        if event.message == Event.DEACTIVATED:
            since = event.stamp_ns
        elif event.message in (Event.ACTIVATED, Event.CONFIGURED):
            if event.message == Event.ACTIVATED and since not in (None, event.stamp_ns):
                yield (
                    f"run/events: {node} inactive at t = {seconds(since or 0):g} s, active again at "
                    f"t = {seconds(event.stamp_ns):g} s: it stands still in between"
                )
            since = None
    last = run.table(relative).stamp_ns.max(initial=-1)
    if since is not None and last > since:
        yield f"run/events: {node} inactive from t = {seconds(since):g} s, but it goes on"


def _counted(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield counts of published messages that are not a node's last word, not whole, or too early."""
    counts = [event for event in told if event.message == Event.PUBLISHED]
    if not counts:
        return
    if told[-1].message != Event.PUBLISHED:
        yield f"run/events: {node} goes on after it has counted what it published"
    own = [relative for relative in _PUBLISHES[node] if run.count(relative)]
    if node in CONTROLLERS and not run.count(_PUBLISHES[node][0]):
        own = []
    missing = {run.recording.topic(relative) for relative in own} - set(counts[-1].values)
    if missing and not any(event.message == Event.CLEANED_UP for event in told):
        yield f"run/events: {node} does not count what it published on {', '.join(sorted(missing))}"
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    last = int(truth.max(initial=-1))
    if node == "disturbance":
        last += run.config(node).period_ns
    if run.exact and counts[-1].stamp_ns != last:
        yield f"run/events: {node} ends at t = {seconds(counts[-1].stamp_ns):g} s, not after the last state"


def _end(run: RecordedRun) -> Iterator[str]:
    """Yield where the run's end does not follow from its parameters and its last state."""
    truth = run.table(topics.GROUND_TRUTH)
    config: SimulatorConfig = run.config("simulator")
    name = run.recording.topic("simulator")
    ends = [e for e in run.events if e.node == name and e.message == Event.FINISHED]
    if not ends or not len(truth):
        return
    last = int(truth.stamp_ns.max())
    if ends[0].stamp_ns != last:
        at = seconds(ends[0].stamp_ns)
        yield f"run/events: finished at t = {at:g} s, the last state is at t = {seconds(last):g} s"
    reason = ends[0].values.get("reason")
    wanted = step_count(config.duration, config.update_rate) if config.duration else None
    fell = [e.stamp_ns for e in run.events if e.node == name and e.message == Event.FELL]
    if any(after <= before for before, after in pairwise(fell)):
        yield "run/events: two falls in one state, or out of order"
    by_fall = config.fall_stop and bool(fell) and fell[-1] == last
    expected = (
        "the trunk has fallen"
        if by_fall
        else "finished"
        if wanted is not None
        else "stopped on request"
    )
    if reason != expected:
        yield f"run/events: ended as {reason!r}; by parameters and states it is {expected!r}"
    if not by_fall and wanted is not None and len(truth) != wanted + 1:
        yield (
            f"{len(truth)} states; duration {config.duration:g} s at {config.update_rate:g} Hz "
            f"has {wanted + 1}"
        )
    if config.fall_stop and any(stamp < last for stamp in fell):
        yield "run/events: fall.stop is set, but the run goes on after a fall"


def _rates(run: RecordedRun) -> Iterator[str]:
    """Yield controllers that a plant in lock-step would have refused."""
    period_ns = run.config("simulator").period_ns
    for name in run.controllers if run.mode == "lockstep" else ():
        ratio = run.config(name).period_ns / period_ns
        if ratio <= 0.999 or abs(ratio - round(ratio)) >= 1e-3:
            yield f"{name}: update_rate is not an integer divisor of the simulator's, in lock-step"


def _parameters(run: RecordedRun) -> Iterator[str]:
    """Yield sets of parameters that are not whole, doubled, late, or changed where they are fixed."""
    prefix = run.recording.topic("")
    sets: Counter[str] = Counter()
    for change in run.recording.parameter_messages():
        node = change.node.removeprefix(prefix)
        if node not in NODES:
            yield f"run/parameters: parameters of {change.node}, which is none of our nodes"
            continue
        declared = declarations(NODES[node].config)
        if change.new:
            sets[node] += 1
            if tuple(change.new) != tuple(declared):
                odd = ", ".join(sorted(set(declared) ^ set(change.new))) or "their order"
                yield f"run/parameters: the set of {node} is not this version's: {odd}"
            if change.stamp_ns:
                yield f"run/parameters: the set of {node} is stamped {change.stamp_ns} ns, not 0"
        if bool(change.new) == bool(change.changed):
            yield f"run/parameters: a message of {node} that neither begins nor changes"
        fixed = [name for name in change.changed if name in declared and declared[name].fixed]
        if fixed:
            yield f"run/parameters: {node} changes {', '.join(fixed)}, fixed at start"
    for node, count in sets.items():
        if count > 1:
            yield f"run/parameters: {count} sets of {node}: it was started again"


def _origin(run: RecordedRun) -> Iterator[str]:
    """Yield where the run's origin is not what the recorder was told, or what ran."""
    origin = run.recording.provenance
    if run.mode == "offline":
        ran = " ".join(name for name in run.parameters if name in CONTROLLERS)
        expected = {"controller": ran, "rmw": "none"}
    elif "recorder" in run.parameters:
        recorder = run.config("recorder")
        expected = {
            "scenario": recorder.scenario,
            "controller": " ".join(recorder.controllers),
            "mode": recorder.mode,
        }
    else:
        yield "no parameters of the recorder: a graph's recorder writes its own"
        return
    for key, value in expected.items():
        if origin.get(key) != value:
            yield f"origin: {key} is {origin.get(key)!r}, by the parameters {value!r}"
    for event in run.events:
        if event.node == run.recording.topic("recorder") and "process" in event.values:
            if event.values["process"] != origin.get("process"):
                yield f"origin: process {origin.get('process')!r}, the recorder is {event.values['process']!r}"
    library = run.recording.library.rsplit("/", 1)[-1]
    if origin.get("mcap") != library:
        yield f"origin: mcap {origin.get('mcap')!r}, the file's header has {library!r}"
