"""One step of a controller as a pure function: *decide* how to answer a state.

A controller has no clock: it goes by the stamps of the states, updates at its ``update_rate``, each time in
the state nearest to the due instant, and holds its command in between. If it becomes active while the plant
moves, its transfer is bumpless: its integral is set so that its first command equals the torque that acts.

Turns, due instants, time steps, the reference, transfer and holding are all handled here. The nodes, the
offline run, the verification and the compiled loop compose this function and add no arithmetic. Several
controllers whose turns fit together take turns at the same state without exchanging messages.

Pure: functions of integers, floats and named tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from trunk_core.units import seconds

from .law import (
    BumplessTransfer,
    Constants,
    Hip,
    Law,
    LawMemory,
    LawTerms,
    Limits,
    Sample,
    Update,
    limited,
)
from .reference import TOPIC, ReferenceProfile, reference_at


class Reading(NamedTuple):
    """A state as one controller reads it."""

    stamp_ns: int  # from 0 up
    position: float  # rad
    velocity: float  # rad/s
    hip: Hip = Hip()  # for laws that use the hip
    effort: float = 0.0  # N m, the torque that acts: where a transfer starts
    has_reference: bool = False  # a reference has arrived by topic
    reference: float = 0.0  # rad, the latest such reference


class Seen(NamedTuple):
    """The last state seen, answered or not."""

    stamp_ns: int = -1  # below 0: none yet
    position: float = 0.0  # rad


class Settings(NamedTuple):
    """The settings around a law in one controller."""

    limits: Limits
    initial: LawMemory  # the law's memory after a reset: a command of 0 within the limits
    no_terms: LawTerms  # where there are none
    profile: ReferenceProfile
    turns_ns: Sequence[int]  # active from the 1st, inactive from the 2nd, ...; empty: always active
    period_ns: int
    handover_step: float  # N m
    gap_ns: int  # longer without a state: start afresh


class Pace(NamedTuple):
    """What decides whether a state is answered, and whether an update is due."""

    active: bool
    begun: bool  # an update has been made since the last reset
    updated_ns: int  # when
    due_ns: int  # when the next one is due
    seen: Seen


class Transfer(NamedTuple):
    """A bumpless transfer of the plant to this controller."""

    pending: bool  # activated while the plant moved, no update yet
    seen_before: Seen  # the last state before the activation
    transferring: bool  # since then the command has not yet reached the law's
    effort: float  # N m, where the command is


class ControllerState(NamedTuple):
    """A controller between two states."""

    memory: LawMemory  # the law's
    sample: Sample  # the law's last
    pace: Pace
    transfer: Transfer


class Output(NamedTuple):
    """A controller's answer to one state."""

    active: bool  # False: not this controller's turn; ignore the rest
    effort: float  # N m
    updated: bool  # True: the law was updated; the terms are those of this update
    held: bool  # True: an update was due, but its input or output was not usable
    reference: float  # rad
    terms: LawTerms
    restarted: bool = False  # True: started afresh, as time went back or after a gap


_SAMPLE = Sample(0.0, 0.0, 0.0, 0.0, Hip(0.0, 0.0))
_NO_TRANSFER = Transfer(False, Seen(-1, 0.0), False, 0.0)


def initial_state(active: bool, seen: Seen, initial: LawMemory) -> ControllerState:
    """Return the state after a reset: the law's memory is the ``initial`` one, there is no past."""
    return ControllerState(initial, _SAMPLE, Pace(active, False, 0, 0, seen), _NO_TRANSFER)


def activated(state: ControllerState, initial: LawMemory) -> ControllerState:
    """Return the state of a controller that answers from the next state of the plant on.

    It starts from scratch, or, if the plant was seen before, from the torque that acts. One that is
    already active is unchanged.
    """
    if state.pace.active:
        return state
    seen = state.pace.seen
    pace, transfer = Pace(True, False, 0, 0, seen), Transfer(seen.stamp_ns >= 0, seen, False, 0.0)
    return ControllerState(initial, _SAMPLE, pace, transfer)


def deactivated(state: ControllerState) -> ControllerState:
    """Return the state of a controller that leaves the plant to another."""
    memory, sample, (_, begun, updated_ns, due_ns, seen), transfer = state
    return ControllerState(memory, sample, Pace(False, begun, updated_ns, due_ns, seen), transfer)


def followed(state: ControllerState, stamp_ns: int, position: float) -> ControllerState:
    """Return the state after one of the plant that was seen but not answered."""
    memory, sample, (active, begun, updated_ns, due_ns, _), transfer = state
    seen = Seen(stamp_ns, position)
    return ControllerState(memory, sample, Pace(active, begun, updated_ns, due_ns, seen), transfer)


def reconfigured(
    state: ControllerState, law: Law, old: Constants, new: Constants, limits: Limits
) -> ControllerState:
    """Return the state under new constants, adapted by the law so that the command does not jump.

    A held command obeys the new limits at once.
    """
    memory = law.reconfigure(state.memory, state.sample, old, new)
    return state._replace(memory=memory._replace(effort=limited(memory.effort, limits)))


def transfer_limits(limits: Limits, effort: float, step: float) -> Limits:
    """Return the limits narrowed to ``effort`` +- ``step`` [N m], never widened."""
    return Limits(
        limits.derivative,
        limits.filter_time,
        limited(effort - step, limits),
        limited(effort + step, limits),
        limits.i_min,
        limits.i_max,
        limits.antiwindup,
        limits.tracking_time_constant,
    )


def turns_begun(times_ns: Sequence[int], stamp_ns: int) -> int:
    """Return how many of the ascending times are at or before a stamp."""
    count = 0
    for time_ns in times_ns:
        if time_ns <= stamp_ns:
            count += 1
    return count


def active_at(times_ns: Sequence[int], stamp_ns: int) -> bool:
    """Return True if a controller is active: from the 1st time to the 2nd, from the 3rd on, ...

    ``times_ns`` ascend; a state at one of the times belongs to the turn that begins there. Empty:
    always active.
    """
    return len(times_ns) == 0 or turns_begun(times_ns, stamp_ns) % 2 == 1


def turn(times_ns: Sequence[int], before_ns: int, stamp_ns: int) -> int:
    """Return the schedule's turn between two states: 1 to activate, -1 to deactivate, 0 nothing."""
    if len(times_ns) == 0 or turns_begun(times_ns, before_ns) == turns_begun(times_ns, stamp_ns):
        return 0
    return 1 if active_at(times_ns, stamp_ns) else -1


def states_per_update(step_ns: int, period_ns: int) -> int:
    """Return which state after an update is nearest to the next due instant, for states ``step_ns`` apart.

    The earlier of two that are equally near. 0: the ratio of the rates is not whole within 1 %.
    """
    states = (2 * period_ns + step_ns - 1) // (2 * step_ns)
    return states if 100 * abs(states * step_ns - period_ns) <= period_ns else 0


def next_due(pace: Pace, stamp_ns: int, period_ns: int) -> int:
    """Return when an update is due after the one at a stamp.

    Due instants follow one another at the set rate. An update starts them anew where it is the first, where
    it comes more than half a period late, and where the ratio of the rates is whole: another clock that
    runs a little faster or slower than ours then neither loses a state nor gets a second update.
    """
    step_ns = stamp_ns - pace.seen.stamp_ns
    late = 2 * (stamp_ns - pace.due_ns) > period_ns
    if not pace.begun or late or (step_ns > 0 and states_per_update(step_ns, period_ns) > 0):
        return stamp_ns + period_ns
    return pace.due_ns + period_ns


def decide(
    state: ControllerState,
    reading: Reading,
    settings: Settings,
    constants: Constants,
    update: Update,
    transfer: BumplessTransfer,
) -> tuple[ControllerState, Output]:
    """Return the next state and the answer to a reading; ``update`` and ``transfer`` are the law's.

    A stamp that goes backwards resets the controller, as time has restarted; so does one after a gap, as
    nothing is known of the time between.
    """
    c, r, s = state, reading, settings
    change = turn(s.turns_ns, c.pace.seen.stamp_ns, r.stamp_ns)
    if change > 0:
        c = activated(c, s.initial)
    elif change < 0:
        c = deactivated(c)
    active, begun, updated_ns, due_ns, seen = c.pace
    if not active:
        c = followed(c, r.stamp_ns, r.position)
        return c, Output(False, c.memory.effort, False, False, 0.0, s.no_terms, False)
    after_gap = seen.stamp_ns >= 0 and r.stamp_ns - seen.stamp_ns > s.gap_ns
    restarted = after_gap or (begun and r.stamp_ns < updated_ns)
    if restarted:
        c = initial_state(True, seen, s.initial)
        _, begun, updated_ns, due_ns, _ = c.pace
    if s.profile.kind == TOPIC and r.has_reference:
        reference = r.reference
    else:
        reference = reference_at(r.stamp_ns, s.profile)
    # The next state, as far away as the last, will be nearer to the due instant.
    if begun and 2 * (due_ns - r.stamp_ns) > r.stamp_ns - seen.stamp_ns:
        c = followed(c, r.stamp_ns, r.position)
        return c, Output(True, c.memory.effort, False, False, reference, s.no_terms, False)
    memory = c.memory
    pending, seen_before, transferring, effort = c.transfer
    step_ns = s.period_ns
    if begun:
        step_ns = r.stamp_ns - updated_ns
    elif pending and r.stamp_ns > seen_before.stamp_ns:
        step_ns = r.stamp_ns - seen_before.stamp_ns
    sample = Sample(reference, r.position, r.velocity, seconds(step_ns), r.hip)
    limits = s.limits
    if pending:
        transferring, effort = True, limited(r.effort, limits)
        memory = transfer(s.initial, seen_before.position, sample, effort, constants, limits)
    if transferring:
        limits = transfer_limits(limits, effort, s.handover_step)
    after, terms = update(memory, sample, constants, limits)
    following_ns = next_due(c.pace, r.stamp_ns, s.period_ns)
    seen = Seen(r.stamp_ns, r.position)
    if terms.held:  # dt keeps counting from the last finite sample
        c = ControllerState(
            memory,
            c.sample,
            Pace(True, begun, updated_ns, due_ns, seen),
            Transfer(pending, seen_before, transferring, effort),
        )
        return c, Output(True, terms.effort, False, True, reference, terms, restarted)
    transferred = c.transfer
    if transferring:  # lift the narrowed limits once they no longer change the command
        transferring = terms.effort != limited(terms.unsaturated, s.limits)
        transferred = Transfer(False, _NO_TRANSFER.seen_before, transferring, terms.effort)
    c = ControllerState(
        after, sample, Pace(True, True, r.stamp_ns, following_ns, seen), transferred
    )
    return c, Output(True, terms.effort, True, False, reference, terms, restarted)


def state_record(output: Output, measurement: float) -> tuple[float, ...]:
    """Return the values of a ``~/state`` record, in the order of `Law.record_names`."""
    return (output.reference, measurement, *output.terms[:-1])
