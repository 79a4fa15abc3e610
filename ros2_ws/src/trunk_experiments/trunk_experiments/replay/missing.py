"""What a recording lacks, and from when on: its recorder came late, was stopped, or a node was killed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event, as_count

from ..recorded.turns import exact_from_ns, idle_ns
from .consistency import killed, uncounted
from .gaps import absent_steps

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun

_TURNS = (Event.ACTIVATED, Event.DEACTIVATED, Event.CLEANED_UP)


def missed_from_ns(run: RecordedRun) -> int | None:
    """Return the first step of which a state or an answer was missed; None without any.

    The recorder came late or could not keep up, or a node was killed before it had handed its answers over.

    What follows depends on it: the plant's state, a law's memory. In a file that is marked as complete, a gap
    is a contradiction.
    """
    if (run.recording.end or {}).get("complete") == "true":
        return None
    period_ns = run.config("simulator").period_ns
    gaps_of = (
        absent_steps(run.table(relative).stamp_ns, period_ns)
        for relative in (topics.GROUND_TRUTH, topics.JOINT_STATES)
    )
    found = [first for count, first in gaps_of if count]
    return min([*found, *_unanswered(run), *_untold(run), *_unmet(run)], default=None)


def _unanswered(run: RecordedRun) -> Iterator[int]:
    """Yield the first state whose command, or disturbance, is missing while later ones are there.

    A node was killed before the recorder had taken them, and started again. In real time a controller may
    miss a state, and a disturbance is missing only if its node published more of them.
    """
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    for relative in (topics.EFFORT_COMMAND, topics.DISTURBANCE):
        stamps = run.table(relative).stamp_ns
        if not run.exact and (
            relative == topics.EFFORT_COMMAND or counted(run, relative) == run.count(relative)
        ):
            continue
        since_ns = exact_from_ns(run) if run.exact else 0.0
        may_join = run.branch is not None or relative not in run.config("simulator").wait_for
        if relative == topics.DISTURBANCE and may_join:
            since_ns = int(stamps.min(initial=0))
        absent = np.setdiff1d(truth[(truth >= since_ns) & (truth < stamps.max(initial=0))], stamps)
        if relative == topics.EFFORT_COMMAND:
            absent = np.setdiff1d(absent, idle_ns(run))
        yield from absent[:1].tolist()


def _untold(run: RecordedRun) -> Iterator[int]:
    """Yield the first command without its terms, if a controller published more of them than are recorded."""
    told = [topics.controller_state(name) for name in run.controllers]
    if any((counted(run, relative) or 0) > run.count(relative) for relative in told):
        terms = np.concatenate([run.table(relative).stamp_ns for relative in told])
        yield from np.setdiff1d(run.table(topics.EFFORT_COMMAND).stamp_ns, terms)[:1].tolist()


def _unmet(run: RecordedRun) -> Iterator[int]:
    """Yield the first state without a disturbance on record, if the simulator took others than are recorded.

    Their node was killed before the recorder had met it. The simulator says when it took the first one, whose
    stamp is at most a step later.
    """
    node = run.recording.topic("simulator")
    said = [e for e in run.events if (e.node, e.message) == (node, "disturbed")]
    if not said:
        return
    truth, there = (run.table(t).stamp_ns for t in (topics.GROUND_TRUTH, topics.DISTURBANCE))
    taken = max(as_count(event.values.get("disturbances", "")) for event in said)
    first_ns = max(said[0].stamp_ns, 0) + run.config("simulator").period_ns
    known = max(len(there), counted(run, topics.DISTURBANCE) or 0)
    if taken > known or (len(there) and int(there.min()) > first_ns):
        yield from np.setdiff1d(truth, there)[:1].tolist()


def counted(run: RecordedRun, relative: str) -> int | None:
    """Return how many messages on a topic the nodes say they published; None if none of them said so."""
    topic = run.recording.topic(relative)
    told = [
        e.values[topic] for e in run.events if e.message == Event.PUBLISHED and topic in e.values
    ]
    return sum(map(as_count, told)) if told else None


def _disturbs(run: RecordedRun) -> bool:
    """Return True if the disturbance was active at some time."""
    if run.mode == "offline" or "disturbance" not in run.parameters:
        return False
    node = run.recording.topic("disturbance")
    turned_on = any(e.node == node and e.message == Event.ACTIVATED for e in run.events)
    return turned_on or run.config("disturbance").autostart


def cut_off_ns(run: RecordedRun) -> int | None:
    """Return the last answer's stamp if a recording may be cut off and lacks its command or terms; else None.

    A chunk may end between the two, the recorder may be stopped, or a controller be killed, which then has no
    last event: what is missing does not count as a difference.
    """
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if not len(commands):
        return None
    if (run.recording.end or {}).get("complete") == "true" and not uncounted(run):
        return _without_terms_ns(run) if run.exact and run.mode != "offline" else None
    told = [run.table(topics.controller_state(name)).stamp_ns for name in run.controllers]
    answers = np.concatenate([commands, *told])
    both = min(
        int(stamps.max(initial=-1)) for stamps in (commands, np.concatenate(told or [commands]))
    )
    later = answers[answers > both].tolist()
    if not run.exact:  # each command has its terms, and of either the last ones may be missing
        return min([*_beyond(run), *later, *_last_words_ns(run)], default=None)
    if run.mode == "offline" or not killed(run):  # one is written after the other
        last = int(answers.max())
        both_there = (commands == last).any() and any((stamps == last).any() for stamps in told)
        later = [] if both_there else [last]
    return min([*_beyond(run), *later], default=None)


def _last_words_ns(run: RecordedRun) -> Iterator[int]:
    """Yield, in real time, from which stamp on a killed controller's commands or terms may be missing.

    One that had been deactivated is taken to have handed all of them over.
    """
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    for name in killed(run):
        node = run.recording.topic(name)
        turns = [e.message for e in run.events if e.node == node and e.message in _TURNS]
        if turns and turns[-1] != Event.ACTIVATED:
            continue
        terms = run.table(topics.controller_state(name)).stamp_ns
        yield int(terms.max(initial=-1)) + 1
        yield from np.setdiff1d(terms, commands)[:1].tolist()


def _without_terms_ns(run: RecordedRun) -> int | None:
    """Return the first command that lacks its terms at the end of a run that is complete without them.

    All states are there and answered. The last terms of a controller that was killed may be lost; they were
    due one period after those that are there.
    """
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    told = {name: run.table(topics.controller_state(name)).stamp_ns for name in run.controllers}
    last = max((int(stamps.max(initial=-1)) for stamps in told.values()), default=-1)
    acting = [
        name
        for name in killed(run)
        if name in run.parameters and told[name].max(initial=-1) == last
    ]
    if not acting:
        return None
    due = last + run.config(acting[0]).period_ns if last >= 0 else 0
    return min(commands[commands >= due].tolist(), default=None)


def _beyond(run: RecordedRun) -> Iterator[int]:
    """Yield the first stamp that depends on an answer after the last recorded ones.

    A command acts on the step to the next state, a disturbance on the measurement of its own; neither acts
    earlier in real time.
    """
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    commands, disturbances = (
        run.table(t).stamp_ns for t in (topics.EFFORT_COMMAND, topics.DISTURBANCE)
    )
    unanswered = np.setdiff1d(truth[truth > commands.max()], idle_ns(run))
    all_there = counted(run, topics.EFFORT_COMMAND) == run.count(topics.EFFORT_COMMAND)
    if not run.exact and all_there and not killed(run):
        unanswered = unanswered[:0]  # nobody answered them
    if len(unanswered) and truth.max() > unanswered[0]:
        yield int(unanswered[0]) + 1
    if not run.exact and counted(run, topics.DISTURBANCE) == len(disturbances):
        return
    if len(disturbances) or _disturbs(run):
        yield from truth[truth > disturbances.max(initial=-1)][:1].tolist()


def recorded_until_ns(run: RecordedRun) -> int | None:
    """Return until when everything is recorded; None if the recorder never missed a part of the run.

    When it became inactive, queued messages of any topic were dropped: the record ends before the first step
    with a missing part, and the last step may have been answered only in part.
    """
    node = run.recording.topic("recorder")
    turns = [e for e in run.events if e.node == node and e.message == Event.DEACTIVATED]
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if not turns or not len(commands) or turns[0].stamp_ns >= commands.max():
        return None
    terms = np.concatenate(
        [run.table(topics.controller_state(n)).stamp_ns for n in run.controllers]
    )
    states = [run.table(t).stamp_ns for t in (topics.GROUND_TRUTH, topics.JOINT_STATES)]
    period_ns = run.config("simulator").period_ns
    firsts = [absent_steps(stamps, period_ns)[1] for stamps in states]
    if not run.exact:  # every command is an update, and has its terms
        firsts += np.setxor1d(commands, terms)[:1].tolist()
    return min(*firsts, int(commands[commands <= turns[0].stamp_ns].max(initial=0))) - 1
