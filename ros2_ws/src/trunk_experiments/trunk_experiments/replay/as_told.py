"""Whether the nodes did what their events say: turns, pauses, inactive times, counts of messages."""

from __future__ import annotations

import reprlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from trunk_control.schedule import active_at
from trunk_msgs_util import topics
from trunk_msgs_util.events import ENDS, Event, as_count
from trunk_msgs_util.recording.schemas import RunEvent
from trunk_msgs_util.units import seconds
from trunk_sim.traffic import Traffic

from ..plans.nodes import CONTROLLERS
from ..plans.timeline import begins_active
from ..recorded.turns import acting

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun

PUBLISHES = {
    "simulator": (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.OPERATOR_PUSH),
    "disturbance": (topics.DISTURBANCE,),
    **{name: (topics.controller_state(name), topics.EFFORT_COMMAND) for name in CONTROLLERS},
}


def not_as_told(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield where a node's messages are not what its events say."""
    if node in CONTROLLERS:
        yield from _acting(run, node, told)
    if node == "simulator":
        yield from _pauses(run, told)
        yield from _still(run, node, told, topics.GROUND_TRUTH)
        yield from _passed_on(run, told)
        yield from _disturbed(run, told)
    if node == "disturbance":
        yield from _still(run, node, told, topics.DISTURBANCE)
    yield from _counted(run, node, told)


def _acting(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield where a controller gave commands while it was inactive by its own events."""
    stamps = np.sort(run.table(topics.controller_state(node)).stamp_ns)
    turns = [e for e in told if e.message in (Event.ACTIVATED, Event.DEACTIVATED)]
    config = run.config(node)
    if run.mode == "offline":
        turns.sort(key=lambda event: event.stamp_ns)  # those from outside come first in the file
    begins = run.mode == "offline" and begins_active(config, run.changes(node))
    active = begins
    for event in turns if run.mode == "offline" else ():
        if active == (event.message == Event.ACTIVATED):
            yield (
                f"run/events: {event.message!r} of {node} at t = {seconds(event.stamp_ns):g} s, "
                "which it already was"
            )
        active = event.message == Event.ACTIVATED
    there = acting(stamps, _turns(turns), begins)
    if not there.all():
        at = seconds(int(stamps[np.flatnonzero(~there)[0]]))
        yield f"{node}: an update at t = {at:g} s, although by run/events it was inactive"
    yield from _schedule(run, node, turns)


def _turns(events: list[RunEvent]) -> Iterator[tuple[int, bool]]:
    """Yield the turns in a node's events, as `acting` takes them."""
    for event in events:
        if event.message in (Event.ACTIVATED, Event.DEACTIVATED):
            yield event.stamp_ns, event.message == Event.ACTIVATED


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


def _passed_on(run: RecordedRun, told: list[RunEvent]) -> Iterator[str]:
    """Yield counts of the links' messages that do not follow from their seed, or are missing at the end."""
    network = run.config("simulator").network
    counted = [event for event in told if event.message == Event.PASSED_ON]
    ends = sum(event.message in ENDS for event in told)
    if network is None:
        if counted:
            yield f"run/events: {str(Event.PASSED_ON)!r}, but there are no links"
        return
    if ends != len(counted):
        yield f"run/events: {str(Event.PASSED_ON)!r} {len(counted)} times, but the run ended {ends} times"
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    for event in counted:
        what = f"run/events: {str(Event.PASSED_ON)!r}"
        states = event.stamp_ns // network.period_ns + 1
        if not 0 < states <= len(truth):
            yield f"{what} at t = {seconds(event.stamp_ns):g} s, not after a state"
        elif event.values != Traffic(network).counts(states):
            said = "; ".join(f"{name}: {text}" for name, text in event.values.items())
            yield f"{what} says {said}, which is not what the links' seed gives"


def _disturbed(run: RecordedRun, told: list[RunEvent]) -> Iterator[str]:
    """Yield what no simulator says of the disturbances it took, and counts of more than are on record.

    It says 1 at the first, and how many there were at the end; nothing in simulated time. What a branch took
    over from its parent in real time is not counted: the parent's disturbances may begin after the branch.
    """
    known, least = run.count(topics.DISTURBANCE), 1
    ends = (Event.PASSED_ON, *ENDS)
    for event, following in zip(told, [*told[1:], None], strict=True):
        if event.message == Event.CLEANED_UP:
            least = 1  # it counts anew
        if event.message != "disturbed":
            continue
        text = event.values.get("disturbances", "")
        count = as_count(text)
        what = f"run/events: {event.message!r} of {count if count >= 0 else reprlib.repr(text)}"
        if run.exact:
            yield f"{what} in a run in simulated time"
        elif count < least or (least == 1) != (count == 1):
            yield f"{what}, where it must be {least if least == 1 else f'{least} or more'}"
        elif count > 1 and (following is None or following.message not in ends):
            yield f"{what}, not at the end of the run"
        elif run.branch is None and count > known:
            yield f"{topics.DISTURBANCE}: {known} messages, but the simulator took {count}"
        least = max(count, 2)


def _pauses(run: RecordedRun, told: list[RunEvent]) -> Iterator[str]:
    """Yield pauses within a pause, ends without one, and pauses in which simulated time advances."""
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
    """Yield where a node published although it was inactive."""
    since: int | None = None
    for event in told:
        if event.message == Event.DEACTIVATED:
            since = event.stamp_ns
        elif event.message in (Event.ACTIVATED, Event.CONFIGURED):
            if event.message == Event.ACTIVATED and since not in (None, event.stamp_ns):
                yield (
                    f"run/events: {node} inactive at t = {seconds(since or 0):g} s, active again at "
                    f"t = {seconds(event.stamp_ns):g} s: it must stand still in between"
                )
            since = None
    last = run.table(relative).stamp_ns.max(initial=-1)
    if since is not None and last > since:
        yield f"run/events: {node} inactive from t = {seconds(since):g} s, but it goes on"


def _counted(run: RecordedRun, node: str, told: list[RunEvent]) -> Iterator[str]:
    """Yield counts of published messages that are not a node's last event, incomplete, or too early."""
    counts = [event for event in told if event.message == Event.PUBLISHED]
    if not counts or node not in PUBLISHES:
        return
    if told[-1].message != Event.PUBLISHED:
        yield f"run/events: {node} goes on after it has counted what it published"
    own = [relative for relative in PUBLISHES[node] if run.count(relative)]
    if node in CONTROLLERS and not run.count(PUBLISHES[node][0]):
        own = []
    missing = {run.recording.topic(relative) for relative in own} - set(counts[-1].values)
    anew = any(event.message == Event.CLEANED_UP for event in told)
    if missing and not anew:
        yield f"run/events: {node} does not count what it published on {', '.join(sorted(missing))}"
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    last = int(truth.max(initial=-1))
    if node == "disturbance":
        last += run.config(node).period_ns
    # The plant does not wait for a controller whose turn is over.
    waited_for = node not in CONTROLLERS or acting(np.array([last]), _turns(told), False).all()
    said = run.table(PUBLISHES[node][0]).stamp_ns.max(initial=-1)
    ahead = run.config(node).period_ns if node == "disturbance" else 0
    if not (run.exact or anew) and counts[-1].stamp_ns < said - ahead:
        yield (
            f"run/events: {node} ends at t = {seconds(counts[-1].stamp_ns):g} s, but publishes on "
            f"{PUBLISHES[node][0]} up to t = {seconds(int(said)):g} s"
        )
    if run.exact and waited_for and counts[-1].stamp_ns != last:
        yield f"run/events: {node} ends at t = {seconds(counts[-1].stamp_ns):g} s, not after the last state"
