"""The closed loop as one loop over pure functions, in stretches: what `batch` and long single runs compile.

It composes the nodes' `sense`, `decide` and `act` and adds no arithmetic. It is also ordinary Python,
so that what numba compiles can be stepped through.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from trunk_control.computed_torque import Hip
from trunk_control.controller import hip_index, setting_of
from trunk_control.decide import Answer, Memory, Reading, Seen, Setting, decide, fresh_memory
from trunk_control.law import Law
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.units import step_count
from trunk_msgs_util.with_arrays import with_arrays
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.plant import PlantState
from trunk_sim.step import Measurement, Plant, SensorParameters, Trunk, act, pruned, sense
from trunk_sim.traffic import Network, Traffic

from ..errors import PlanError
from ..plans.plan import RunPlan, check_turns
from .offline import check

_QUIET = Disturbance()  # constants: numba's named tuples have no default values
_STILL = Hip()


class Wire(NamedTuple):
    """The links of one run: which messages are in use in each step, and those that may still be used."""

    seen: Integers  # [states], the step whose reading is in use
    told: Integers  # [states], the step whose command is in use, -1: none
    readings: Floats  # [greatest age + 1, 5]: the sensors' readings, and the torque, N m
    commands: Floats  # [greatest age + 1], N m


class Surroundings(NamedTuple):
    """What surrounds the controllers in one run."""

    initial: PlantState
    plant: Plant
    sensor: SensorParameters
    signals: Signals
    disturbed: bool  # False: nothing disturbs, whatever ``signals`` holds
    delay_steps: int
    period_ns: int
    fall_stop: bool
    states: int  # of a run to its end
    wire: Wire | None = None  # None: every message arrives at once


class Participant(NamedTuple):
    """A controller in the loop: what `decide` takes, and which motion it reads besides the trunk's."""

    setting: Setting
    constants: Any
    hip: int  # 0: the hip's, 1: the trunk's, -1: none


class Acted(NamedTuple):
    """What the loop uses of a controller's answer: of the same type for all laws."""

    active: bool
    fresh: bool
    effort: float  # N m
    reference: float  # rad


# Nested pairs, ``(first, (second, ()))``: each law's constants have a different type.
Chain = tuple[Any, ...]
Decided = tuple[Chain, Acted]

# Of a law: the function that writes down an update, ``tell(out, row, answer, measured)``.
Tell = Callable[[Law], Callable[[Floats, int, Answer, Measurement], None]]


def reading_of(stamp_ns: int, measured: Measurement, effort: float, hip: int) -> Reading:
    """Return a measured state as read by a controller that uses this joint as the hip."""
    motion = _STILL
    if hip == 0:
        motion = Hip(measured.x, measured.x_dot)
    elif hip == 1:
        motion = Hip(measured.theta, measured.theta_dot)
    return Reading(stamp_ns, measured.theta, measured.theta_dot, motion, effort, False, 0.0)


def decide_by(
    law: Law, others: Callable[..., Decided] | None, tell: Tell
) -> Callable[..., Decided]:
    """Return a function that decides for a law's controller and then for the ``others``.

    It takes ``(memories, participants, stamp_ns, measured, effort, out, row)``, memories and participants as
    `Chain`. It returns the next memories and the active controller's answer, and writes that controller's
    update into the row.
    """
    update, take_over = law.update, law.take_over
    write_down = tell(law)

    def decide_one(
        memory: Any,
        one: Any,
        stamp_ns: int,
        measured: Measurement,
        effort: float,
        out: Floats,
        row: int,
    ) -> tuple[Any, Acted]:
        reading = reading_of(stamp_ns, measured, effort, one.hip)
        after, a = decide(memory, reading, one.setting, one.constants, update, take_over)
        if a.active and a.fresh:
            write_down(out, row, a, measured)
        return after, Acted(a.active, a.fresh, a.effort, a.reference)

    def last(
        memories: Chain,
        participants: Chain,
        stamp_ns: int,
        measured: Measurement,
        effort: float,
        out: Floats,
        row: int,
    ) -> Decided:
        after, acted = decide_one(
            memories[0], participants[0], stamp_ns, measured, effort, out, row
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
        out: Floats,
        row: int,
    ) -> Decided:
        after, acted = decide_one(
            memories[0], participants[0], stamp_ns, measured, effort, out, row
        )
        rest, other = others(memories[1], participants[1], stamp_ns, measured, effort, out, row)
        return (after, rest), acted if acted.active else other

    return first


def read_by_wire(
    k: int, measured: Measurement, effort: float, wire: Wire | None
) -> tuple[Measurement, float]:
    """Return what the controller reads in step k: the sensors, and the torque over the last step, N m."""
    if wire is None:
        return measured, effort
    readings = wire.readings
    here, there = k % len(readings), wire.seen[k] % len(readings)
    readings[here, 0], readings[here, 1] = measured.x, measured.theta
    readings[here, 2], readings[here, 3] = measured.x_dot, measured.theta_dot
    readings[here, 4] = effort
    seen = Measurement(
        readings[there, 0], readings[there, 1], readings[there, 2], readings[there, 3]
    )
    return seen, readings[there, 4]


def told_by_wire(k: int, effort: float, wire: Wire | None) -> float:
    """Return the torque that the plant receives in step k, N m, if the controller sends ``effort``."""
    if wire is None:
        return effort
    commands = wire.commands
    commands[k % len(commands)] = effort
    told = wire.told[k]
    return commands[told % len(commands)] if told >= 0 else 0.0


# How a stretch ends.
GOES_ON, ENDED, DIVERGED = range(3)

# Writes down one state: ``keep(out, row, trunk, acting, measured, felt, acted, effort, plant)``. A controller
# reads the torque ``felt``, the plant receives ``effort``, both N m.
Keep = Callable[[Floats, int, Trunk, Disturbance, Measurement, float, Acted, float, Plant], None]


def stretch_of(*laws: Law, keep: Keep, tell: Tell) -> Callable[..., tuple[int, int, Trunk, Chain]]:
    """Return the loop of a run with these laws, in the order of its participants.

    ``stretch(first, stop, surroundings, trunk, memories, participants, noise, history, out)`` computes the
    states in [first, stop), state ``first`` being that of ``trunk``, and writes state k into row
    ``k - first`` of ``out``. It returns how many states of the run there are now; how it ends: `GOES_ON`,
    `ENDED` (by a fall, or after the last state) or `DIVERGED` (in the step after the last of them); and
    trunk and memories, for the next stretch.

    ``noise`` [stop - first, 2] are standard normal samples; its last row is used for all that follow.
    ``history`` [delay_steps + 1, 4] keeps the states that the sensors still have to see.
    """
    decide_all: Callable[..., Decided] | None = None
    for law in reversed(laws):
        decide_all = decide_by(law, decide_all, tell)
    if decide_all is None:
        raise ValueError("a loop needs a law")

    def stretch(
        first: int,
        stop: int,
        surroundings: Surroundings,
        trunk: Trunk,
        memories: Chain,
        participants: Chain,
        noise: Floats,
        history: Floats,
        out: Floats,
    ) -> tuple[int, int, Trunk, Chain]:
        s = surroundings
        last = s.states - 1
        for k in range(first, stop):
            stamp_ns = k * s.period_ns
            acting = disturbance_at(stamp_ns, s.signals) if s.disturbed else _QUIET
            delayed = trunk.state
            if s.delay_steps > 0:
                here, seen = k % len(history), max(k - s.delay_steps, 0) % len(history)
                history[here, 0], history[here, 1] = delayed.x, delayed.theta
                history[here, 2], history[here, 3] = delayed.x_dot, delayed.theta_dot
                delayed = PlantState(
                    history[seen, 0], history[seen, 1], history[seen, 2], history[seen, 3]
                )
            row = min(k - first, len(noise) - 1)
            sensed = sense(delayed, acting, noise[row, 0], noise[row, 1], s.sensor)
            measured, felt = read_by_wire(k, sensed, trunk.effort, s.wire)
            memories, acted = decide_all(
                memories, participants, stamp_ns, measured, felt, out, k - first
            )
            effort = told_by_wire(k, acted.effort, s.wire)
            keep(out, k - first, trunk, acting, measured, felt, acted, effort, s.plant)
            if k == last or (s.fall_stop and trunk.fallen):
                return k + 1, ENDED, trunk, memories
            after = act(trunk, effort, acting, s.plant)
            if after.diverged:
                return k + 1, DIVERGED, trunk, memories
            trunk = after
        return stop, GOES_ON, trunk, memories

    names = [keep.__name__, *(law.update.__module__ for law in laws)]
    stretch.__name__ = stretch.__qualname__ = "_".join(["stretch", *names])
    return stretch


def check_compilable(plan: RunPlan) -> None:
    """Raise PlanError for a plan that a compiled loop cannot model."""
    check(plan)
    check_turns(plan)
    if plan.changes:
        raise PlanError(
            f"{', '.join(plan.changes)}: parameters and turns that change by hand while the run goes "
            "on are not compiled: give active.times, or use simulate"
        )
    if plan.references:
        raise PlanError("references that come by topic are not compiled: use simulate")
    if plan.pushes:
        raise PlanError("what an operator does is not compiled: use simulate")


def states_of(plan: RunPlan) -> int:
    """Return the number of states of a plan's run to its end."""
    return step_count(plan.simulator.duration, plan.simulator.update_rate) + 1


def surroundings_of(plan: RunPlan) -> Surroundings:
    """Return what surrounds the controllers in a plan's run."""
    simulator, disturbance = plan.simulator, plan.disturbance
    return Surroundings(
        simulator.initial_state,
        pruned(simulator.plant),
        simulator.sensor,
        _quiet() if disturbance is None else with_arrays(disturbance.signals),
        disturbance is not None,
        simulator.delay_steps,
        simulator.period_ns,
        simulator.fall_stop,
        states_of(plan),
        None if simulator.network is None else wire_of(simulator.network, states_of(plan)),
    )


def wire_of(network: Network, states: int) -> Wire:
    """Return the links of a run with so many states."""
    traffic, steps = Traffic(network), np.arange(states)
    seen, told = traffic.all_seen(states), traffic.all_told(states)
    oldest = int((steps - seen).max(initial=0)), int((steps - told)[told >= 0].max(initial=0))
    return Wire(seen, told, np.empty((oldest[0] + 1, 5)), np.empty(oldest[1] + 1))


def chains_of(plan: RunPlan) -> tuple[Chain, Chain]:
    """Return the memories at the start, and the participants, of a plan's controllers."""
    memories: Chain = ()
    participants: Chain = ()
    joints = plan.simulator.joints
    for config in reversed(list(plan.controllers.values())):
        setting = setting_of(config)
        hip = hip_index(config, joints)
        memory: Memory = fresh_memory(not config.active_times, Seen(-1, 0.0), setting.initial)
        memories = (memory, memories)
        participants = (
            Participant(
                with_arrays(setting),
                tuple(with_arrays(one) for one in config.constants),
                -1 if hip is None else hip,
            ),
            participants,
        )
    return memories, participants


@cache
def _quiet() -> Signals:
    none: Signals = with_arrays(
        Signals(0, (), 0, 0.0, 0, 0.0, 0.0, 0.0, 0, 0.0, (), (), 0, True, (), ())
    )
    return none
