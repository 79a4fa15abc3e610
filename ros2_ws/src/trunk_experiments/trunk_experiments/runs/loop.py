"""The closed loop over the nodes' pure functions, in segments of consecutive states.

It composes `sense`, `decide` and `act` and adds no arithmetic. What it does not compute, it takes from a
`Schedule`: pushes and references from outside, or a recording's states, commands and disturbances, where
a run is verified. CPython runs the loop as it is, and numba compiles it unchanged.
The lanes of a batch and the environments compose the same functions side by side, held to the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any, NamedTuple

from trunk_control.decide import Output, Reading, Settings, decide
from trunk_control.law import Hip, Law
from trunk_msgs_util.recording.joint_table import Floats, Integers
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.plant import PlantState
from trunk_sim.step import (
    Measurement,
    Plant,
    PlantStatus,
    SensorParameters,
    act,
    sense,
    timely_effort,
)

from .schedule import (
    Schedule,
    Wire,
    pushed,
    read_by_wire,
    recorded_disturbance,
    recorded_reading,
    recorded_trunk,
    scheduled,
    stamp_at,
    used_by_wire,
)

_QUIET = Disturbance()  # constants: numba's named tuples have no default values
_STILL = Hip()


# Nested pairs, ``(first, (second, ()))``: each law's constants have a different type.
Chain = tuple[Any, ...]


class Surroundings(NamedTuple):
    """What surrounds the controllers, from one change of parameters to the next."""

    plant: Plant
    sensor: SensorParameters
    signals: Signals
    disturbed: bool  # False: nothing disturbs, whatever ``signals`` holds
    delay_steps: int
    remembered: int  # the oldest state that the sensors have not forgotten
    period_ns: int
    timeout_ns: int  # a command that is older no longer acts
    fall_stop: bool
    wire: Wire | None = None  # None: every message arrives at once


class LoopState(NamedTuple):
    """The loop between two states: what the rest of the run depends on."""

    trunk: PlantStatus
    memories: Chain
    command: float  # N m, the last one that a controller gave
    command_ns: int  # ... and the stamp that it answers
    begun: bool  # True: a step with what follows leads to the next state
    effort: float  # N m, what reaches the plant in that step
    acting: Disturbance  # in that step, with what an operator does


class Participant(NamedTuple):
    """A controller in the loop: what `decide` takes, and which motion it reads besides the trunk's."""

    settings: Settings
    constants: Any
    hip: int  # 0: the hip's, 1: the trunk's, -1: none


class Decision(NamedTuple):
    """What the loop uses of the first active controller's answer: of the same type for all laws."""

    active: int  # bit i: the controller at place i is active
    updated: bool  # its law
    effort: float  # N m
    reference: float  # rad


Decided = tuple[Chain, Decision]

# Of a law: the function that writes down an update, ``tell(out, row, answer, measured)``.
Tell = Callable[[Law], Callable[[Floats, int, Output, Measurement], None]]


def reading_of(
    stamp_ns: int, measured: Measurement, effort: float, hip: int, reference: float
) -> Reading:
    """Return a measured state as read by a controller that uses this joint as the hip.

    ``reference``: the latest by topic, rad; NaN: none has come.
    """
    motion = _STILL
    if hip == 0:
        motion = Hip(measured.x, measured.x_dot)
    elif hip == 1:
        motion = Hip(measured.theta, measured.theta_dot)
    received = reference == reference
    return Reading(
        stamp_ns,
        measured.theta,
        measured.theta_dot,
        motion,
        effort,
        received,
        reference if received else 0.0,
    )


def reads_state(row: int, place: int, reads: Integers | None) -> bool:
    """Return True if the participant at this place gets the state of a row."""
    return True if reads is None or len(reads) == 0 else bool(reads[row, place] != 0)


def decide_by(
    law: Law, place: int, others: Callable[..., Decided] | None, tell: Tell
) -> Callable[..., Decided]:
    """Return a function that decides for a law's controller, at a place, and then for the ``others``.

    It takes ``(memories, participants, stamp_ns, measured, effort, reference, reads, out, row)``, memories
    and participants as `Chain`. It returns the next memories and the first active controller's answer, and
    writes that controller's update into the row.
    """
    update, transfer = law.update, law.transfer
    write_down = tell(law)
    bit = 1 << place

    def decide_one(
        memory: Any,
        participant: Any,
        stamp_ns: int,
        measured: Measurement,
        effort: float,
        reference: float,
        out: Floats,
        row: int,
    ) -> tuple[Any, Decision]:
        reading = reading_of(stamp_ns, measured, effort, participant.hip, reference)
        after, a = decide(
            memory, reading, participant.settings, participant.constants, update, transfer
        )
        if a.active and a.updated:
            write_down(out, row, a, measured)
        return after, Decision(bit if a.active else 0, a.updated, a.effort, a.reference)

    def last(
        memories: Chain,
        participants: Chain,
        stamp_ns: int,
        measured: Measurement,
        effort: float,
        reference: float,
        reads: Integers | None,
        out: Floats,
        row: int,
    ) -> Decided:
        if not reads_state(row, place, reads):
            return memories, Decision(0, False, 0.0, 0.0)
        after, acted = decide_one(
            memories[0], participants[0], stamp_ns, measured, effort, reference, out, row
        )
        return (after, ()), acted

    if others is None:
        return last

    def first(
        memories: Chain,
        participants: Chain,
        stamp_ns: int,
        measured: Measurement,
        effort: float,
        reference: float,
        reads: Integers | None,
        out: Floats,
        row: int,
    ) -> Decided:
        after, acted = memories[0], Decision(0, False, 0.0, 0.0)
        if reads_state(row, place, reads):
            after, acted = decide_one(
                memories[0], participants[0], stamp_ns, measured, effort, reference, out, row
            )
        rest, other = others(
            memories[1], participants[1], stamp_ns, measured, effort, reference, reads, out, row
        )
        if acted.active == 0:
            return (after, rest), other
        both = acted.active | other.active
        return (after, rest), Decision(both, acted.updated, acted.effort, acted.reference)

    return first


def decide_none(
    memories: Chain,
    participants: Chain,
    stamp_ns: int,
    measured: Measurement,
    effort: float,
    reference: float,
    reads: Integers | None,
    out: Floats,
    row: int,
) -> Decided:
    """Return that nobody answers: the commands come from a schedule."""
    return memories, Decision(0, False, 0.0, 0.0)


# How a segment ends.
GOES_ON, FELL, DIVERGED = range(3)

# Writes down one state: ``keep(out, row, trunk, acting, measured, measured_torque, acted, effort, plant)``.
# A controller reads ``measured_torque``, the plant receives ``effort``, both N m.
Keep = Callable[
    [Floats, int, PlantStatus, Disturbance, Measurement, float, Decision, float, Plant], None
]


def segment_of(*laws: Law, keep: Keep, tell: Tell) -> Callable[..., tuple[int, int, LoopState]]:
    """Return the loop of a run with these laws, in the order of its participants; without any, a plant alone.

    ``segment(first, stop, surroundings, state, participants, noise, history, schedule, out)`` computes the
    states with indices in [first, stop) and writes state k into row ``k - first`` of ``out``. It returns the
    index of the first state that it did not compute; why: `GOES_ON`, `FELL` (the run ends by a fall) or
    `DIVERGED` (the step to that state is not finite); and the loop's state there, for the next segment.

    ``noise`` [stop - first, 2] are standard normal samples; its last row is used for all that follow.
    ``history`` [delay_steps + 1, 4] keeps the states that the sensors still have to see.
    """
    decide_all: Callable[..., Decided] = decide_none
    for place, law in reversed(list(enumerate(laws))):
        decide_all = decide_by(law, place, None if decide_all is decide_none else decide_all, tell)

    def segment(
        first: int,
        stop: int,
        surroundings: Surroundings,
        state: LoopState,
        participants: Chain,
        noise: Floats,
        history: Floats,
        schedule: Schedule,
        out: Floats,
    ) -> tuple[int, int, LoopState]:
        s, given = surroundings, schedule
        trunk, memories, begun = state.trunk, state.memories, state.begun
        command, command_ns = state.command, state.command_ns
        effort, acting = state.effort, state.acting
        for k in range(first, stop):
            if begun:
                fell = s.fall_stop and trunk.fallen
                after = act(trunk, effort, acting, s.plant)
                if fell or after.diverged:
                    return (
                        k,
                        FELL if fell else DIVERGED,
                        LoopState(trunk, memories, command, command_ns, True, effort, acting),
                    )
                trunk = after
            begun = True
            row = k - first
            stamp_ns = stamp_at(row, k * s.period_ns, given.stamp_ns)
            computed = trunk
            trunk = recorded_trunk(row, computed, given.truth)
            signalled = disturbance_at(stamp_ns, s.signals) if s.disturbed else _QUIET
            in_state = recorded_disturbance(row, signalled, given.disturbance)
            delayed = trunk.state
            if s.delay_steps > 0:
                here = k % len(history)
                there = max(k - s.delay_steps, s.remembered) % len(history)
                history[here, 0], history[here, 1] = delayed.x, delayed.theta
                history[here, 2], history[here, 3] = delayed.x_dot, delayed.theta_dot
                delayed = PlantState(
                    float(history[there, 0]),
                    float(history[there, 1]),
                    float(history[there, 2]),
                    float(history[there, 3]),
                )
            sample = min(row, len(noise) - 1)
            sensed = sense(
                delayed, in_state, float(noise[sample, 0]), float(noise[sample, 1]), s.sensor
            )
            measured, measured_torque = read_by_wire(k, sensed, trunk.effort, s.wire)
            seen, seen_effort = recorded_reading(row, measured, measured_torque, given.measured)
            memories, acted = decide_all(
                memories,
                participants,
                stamp_ns,
                seen,
                seen_effort,
                scheduled(row, nan, given.reference),
                given.reads,
                out,
                row,
            )
            if acted.active != 0:
                command, command_ns = acted.effort, stamp_ns
            held = timely_effort(command, stamp_ns - command_ns, s.timeout_ns)
            effort = used_by_wire(k, scheduled(row, held, given.command), s.wire)
            keep(out, row, computed, in_state, measured, measured_torque, acted, effort, s.plant)
            acting = pushed(row, in_state, given.push)
        return stop, GOES_ON, LoopState(trunk, memories, command, command_ns, begun, effort, acting)

    names = [keep.__name__, *(law.update.__module__ for law in laws)]
    segment.__name__ = segment.__qualname__ = "_".join(["segment", *names])
    return segment
