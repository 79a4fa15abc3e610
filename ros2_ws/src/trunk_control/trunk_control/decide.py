"""One step of a controller as a pure function: *decide* how to answer a state.

A controller has no clock: it goes by the stamps of the states, updates at most at its ``update_rate``
and holds its command in between. If it becomes active while the plant moves, it takes over bumplessly:
its integral is set so that its first command equals the torque already acting.

Turns, due instants, time steps, the reference, takeover and holding are all handled here. The nodes, the
offline run, the replay and the compiled loop compose this function and add no arithmetic.

Pure: functions of integers, floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from trunk_msgs_util.units import seconds

from .law import Constants, Hip, Law, LawMemory, LawTerms, Sample, TakeOver, Update
from .limits import Limits, limited
from .reference import TOPIC, ReferenceProfile, reference_at
from .schedule import turn


class Reading(NamedTuple):
    """A state as one controller reads it."""

    stamp_ns: int
    position: float  # rad
    velocity: float  # rad/s
    hip: Hip = Hip()  # for laws that use the hip
    effort: float = 0.0  # N m, the torque that acts: where a takeover starts
    told: bool = False  # a reference has arrived by topic
    reference: float = 0.0  # rad, the latest such reference


class Seen(NamedTuple):
    """The last state seen, answered or not."""

    stamp_ns: int = -1  # below 0: none yet
    position: float = 0.0  # rad


class Setting(NamedTuple):
    """The settings around a law in one controller."""

    law: Limits
    initial: LawMemory  # the law's memory after a reset: a command of 0 within the limits
    no_terms: LawTerms  # where there are none
    profile: ReferenceProfile
    turns_ns: Sequence[int]  # active from the 1st, inactive from the 2nd, ...; empty: always active
    period_ns: int
    due_after_ns: int  # an update is due this long after the last
    handover_step: float  # N m
    gap_ns: int  # longer without a state: start afresh


class Memory(NamedTuple):
    """A controller between two states."""

    state: LawMemory  # the law's
    sample: Sample  # the law's last
    active: bool
    begun: bool  # an update has been made since the last reset
    updated_ns: int  # when
    seen: Seen
    takes_over: bool  # activated while the plant moved, no update yet
    taken_from: Seen  # the state before
    moving: bool  # since the takeover, the command has not yet reached the law's
    moved_to: float  # N m, where the command is


class Answer(NamedTuple):
    """A controller's answer to one state."""

    active: bool  # False: not this controller's turn; ignore the rest
    effort: float  # N m
    fresh: bool  # True: the law was updated; the terms are those of this update
    held: bool  # True: an update was due, but its input or output was not usable
    reference: float  # rad
    terms: LawTerms


_SAMPLE = Sample(0.0, 0.0, 0.0, 0.0, Hip(0.0, 0.0))
_NEVER = Seen(-1, 0.0)


def fresh_memory(active: bool, seen: Seen, initial: LawMemory) -> Memory:
    """Return the memory after a reset: the law's own is the ``initial`` one, there is no past."""
    return Memory(initial, _SAMPLE, active, False, 0, seen, False, _NEVER, False, 0.0)


def activated(memory: Memory, initial: LawMemory) -> Memory:
    """Return the memory of a controller that answers from the next state on.

    It starts from scratch, or, if a state was seen before, from the torque that acts. One that is
    already active is unchanged.
    """
    if memory.active:
        return memory
    m = fresh_memory(True, memory.seen, initial)
    takes_over = memory.seen.stamp_ns >= 0
    return Memory(
        m.state, m.sample, True, False, 0, m.seen, takes_over, memory.seen, m.moving, m.moved_to
    )


def deactivated(memory: Memory) -> Memory:
    """Return the memory of a controller that hands over the plant."""
    m = memory
    return Memory(
        m.state,
        m.sample,
        False,
        m.begun,
        m.updated_ns,
        m.seen,
        m.takes_over,
        m.taken_from,
        m.moving,
        m.moved_to,
    )


def followed(memory: Memory, stamp_ns: int, position: float) -> Memory:
    """Return the memory after a state that was seen but not answered."""
    m = memory
    return Memory(
        m.state,
        m.sample,
        m.active,
        m.begun,
        m.updated_ns,
        Seen(stamp_ns, position),
        m.takes_over,
        m.taken_from,
        m.moving,
        m.moved_to,
    )


def retuned(memory: Memory, law: Law, old: Constants, new: Constants, limits: Limits) -> Memory:
    """Return the memory under new constants, adapted by the law so that the command does not jump.

    A held command obeys the new limits at once.
    """
    state = law.retune(memory.state, memory.sample, old, new)
    return memory._replace(state=state._replace(effort=limited(state.effort, limits)))


def after_gap(seen: Seen, stamp_ns: int, setting: Setting) -> bool:
    """Return True if nothing is to be integrated since the last state seen, as it was too long ago."""
    return seen.stamp_ns >= 0 and stamp_ns - seen.stamp_ns > setting.gap_ns


def handover_law(law: Limits, effort: float, step: float) -> Limits:
    """Return the law with its limits narrowed to ``effort`` +- ``step`` [N m], never widened."""
    return Limits(
        law.derivative,
        law.filter_time,
        limited(effort - step, law),
        limited(effort + step, law),
        law.i_min,
        law.i_max,
        law.antiwindup,
        law.tracking_time_constant,
    )


def decide(
    memory: Memory,
    reading: Reading,
    setting: Setting,
    constants: Constants,
    update: Update,
    take_over: TakeOver,
) -> tuple[Memory, Answer]:
    """Return the next memory and the answer to a state; ``update`` and ``take_over`` are the law's.

    A stamp that goes backwards resets the controller, as time has restarted; so does one after a gap, as
    nothing is known of the time between.
    """
    m, r, s = memory, reading, setting
    wanted = turn(s.turns_ns, m.seen.stamp_ns, r.stamp_ns)
    if wanted > 0:
        m = activated(m, s.initial)
    elif wanted < 0:
        m = deactivated(m)
    if not m.active:
        m = followed(m, r.stamp_ns, r.position)
        return m, Answer(False, m.state.effort, False, False, 0.0, s.no_terms)
    if after_gap(m.seen, r.stamp_ns, s) or (m.begun and r.stamp_ns < m.updated_ns):
        m = fresh_memory(True, m.seen, s.initial)
    seen = Seen(r.stamp_ns, r.position)
    if s.profile.kind == TOPIC and r.told:
        reference = r.reference
    else:
        reference = reference_at(r.stamp_ns, s.profile)
    if m.begun and r.stamp_ns - m.updated_ns < s.due_after_ns:
        m = followed(m, r.stamp_ns, r.position)
        return m, Answer(True, m.state.effort, False, False, reference, s.no_terms)
    step_ns = s.period_ns
    if m.begun:
        step_ns = r.stamp_ns - m.updated_ns
    elif m.takes_over and r.stamp_ns > m.taken_from.stamp_ns:
        step_ns = r.stamp_ns - m.taken_from.stamp_ns
    sample = Sample(reference, r.position, r.velocity, seconds(step_ns), r.hip)
    state, moving, moved_to = m.state, m.moving, m.moved_to
    if m.takes_over:
        moving, moved_to = True, limited(r.effort, s.law)
        state = take_over(s.initial, m.taken_from.position, sample, moved_to, constants, s.law)
    law = handover_law(s.law, moved_to, s.handover_step) if moving else s.law
    after, terms = update(state, sample, constants, law)
    if terms.held:  # dt keeps counting from the last finite sample
        m = Memory(
            state,
            m.sample,
            True,
            m.begun,
            m.updated_ns,
            seen,
            m.takes_over,
            m.taken_from,
            moving,
            moved_to,
        )
        return m, Answer(True, terms.effort, False, True, reference, terms)
    if moving:  # lift the narrowed limits once they no longer change the command
        moving = terms.effort != limited(terms.unsaturated, s.law)
        moved_to = terms.effort
    m = Memory(after, sample, True, True, r.stamp_ns, seen, False, _NEVER, moving, moved_to)
    return m, Answer(True, terms.effort, True, False, reference, terms)


def state_record(answer: Answer, measurement: float) -> tuple[float, ...]:
    """Return the values of a ``~/state`` record, in the order of `Law.record_names`."""
    return (answer.reference, measurement, *answer.terms[:-1])
