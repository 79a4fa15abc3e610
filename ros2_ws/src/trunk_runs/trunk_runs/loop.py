"""The closed loop over the nodes' pure functions, in segments of consecutive states, and what it takes.

It composes `sense`, `decide` and `act` and adds no arithmetic. What it does not compute, it takes from a
`Schedule`: pushes and references from outside, links, or a recording's states, commands and disturbances,
where a run is verified. Of a plan come surroundings, participants, schedule and samples of noise. CPython
runs the loop as it is, and numba compiles it unchanged: functions of numbers, arrays and named tuples.
The lanes of a batch and the environments compose the same functions side by side, held to the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import nan
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import Controller, hip_index
from trunk_control.decide import Output, Reading, Settings, decide
from trunk_control.law import ControllerConfig, Hip, Law
from trunk_core.arrays import Floats, Integers
from trunk_core.compiled import with_arrays
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import Value
from trunk_core.topics import Event
from trunk_core.units import nanoseconds, step_count
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.inputs import Applied, with_operator
from trunk_sim.links import Network, Traffic
from trunk_sim.noise import noise_samples
from trunk_sim.plant import PlantState
from trunk_sim.step import (
    Dynamics,
    Measurement,
    PlantConstants,
    PlantStatus,
    Scale,
    SensorParameters,
    act,
    of_one_type,
    sense,
    timely_effort,
)

from .plan import RunPlan, check_joints, check_turns
from .timeline import Operated


class Wire(NamedTuple):
    """The links of one run: which messages are in use in each step, and those that may still be used."""

    seen: Integers  # [states], the step whose reading is in use
    used: Integers  # [states], the step whose command is in use, -1: none
    readings: Floats  # [greatest age + 1, 5]: the sensors' readings, and the torque, N m
    commands: Floats  # [greatest age + 1], N m


class Schedule(NamedTuple):
    """What n states take from outside instead of computing it; None, or NaN in a row: it is computed.

    With ``truth``, each state is compared with the record and goes on from it: it has the same bits only if
    the recorded state before it leads to it.
    """

    truth: Floats | None = None  # [n, 5]: x, theta, their rates, torque over the step before
    measured: Floats | None = None  # [n, 5], likewise: what the controllers read
    disturbance: Floats | None = None  # [n, 4], in the order of the channels
    command: Floats | None = None  # [n], in force over the step from the state, N m
    push: Floats | None = None  # [n, 2], an operator's, over the step from the state: N, N m
    reference: Floats | None = (
        None  # [n], the latest one that came by topic, rad; NaN: none has come
    )
    reads: Integers | None = None  # [n, participants], 0 where a participant does not get the state
    stamp_ns: Integers | None = None  # [n], where the states are not those of our plant


NO_WIRE = Wire(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((1, 5)), np.zeros(1))
_NOTHING = Schedule(
    truth=np.zeros((0, 5)),
    measured=np.zeros((0, 5)),
    disturbance=np.zeros((0, 4)),
    command=np.zeros(0),
    push=np.zeros((0, 2)),
    reference=np.zeros(0),
    reads=np.zeros((0, 0), np.int64),
    stamp_ns=np.zeros(0, np.int64),
)


def schedule_for_compiler(schedule: Schedule) -> Schedule:
    """Return a schedule as compiled code takes it: an empty array for what is computed."""
    given = {name: value for name, value in schedule._asdict().items() if value is not None}
    return _NOTHING._replace(**given)


def read_by_wire(
    k: int, measured: Measurement, effort: float, wire: Wire | None
) -> tuple[Measurement, float]:
    """Return the controller's reading in step k: the sensors, and the torque over the last step, N m."""
    if wire is None:
        return measured, effort
    if len(wire.seen) == 0:
        return measured, effort
    readings = wire.readings
    here, there = k % len(readings), wire.seen[k] % len(readings)
    readings[here, 0], readings[here, 1] = measured.x, measured.theta
    readings[here, 2], readings[here, 3] = measured.x_dot, measured.theta_dot
    readings[here, 4] = effort
    seen = Measurement(
        float(readings[there, 0]),
        float(readings[there, 1]),
        float(readings[there, 2]),
        float(readings[there, 3]),
    )
    return seen, float(readings[there, 4])


def used_by_wire(k: int, effort: float, wire: Wire | None) -> float:
    """Return the torque that the plant receives in step k, N m, if ``effort`` is in force before the link."""
    if wire is None:
        return effort
    if len(wire.used) == 0:
        return effort
    commands = wire.commands
    commands[k % len(commands)] = effort
    used = wire.used[k]
    return float(commands[used % len(commands)]) if used >= 0 else 0.0


def recorded_trunk(row: int, trunk: PlantStatus, truth: Floats | None) -> PlantStatus:
    """Return the trunk as the record has it; as computed where it has none."""
    if truth is None or len(truth) == 0 or truth[row, 0] != truth[row, 0]:
        return trunk
    state = PlantState(
        float(truth[row, 0]), float(truth[row, 1]), float(truth[row, 2]), float(truth[row, 3])
    )
    return PlantStatus(state, float(truth[row, 4]), trunk.fallen, False)


def recorded_reading(
    row: int, measured: Measurement, effort: float, readings: Floats | None
) -> tuple[Measurement, float]:
    """Return a measured state and the torque in it as the record has them; as computed where it has none."""
    if readings is None or len(readings) == 0 or readings[row, 0] != readings[row, 0]:
        return measured, effort
    seen = Measurement(
        float(readings[row, 0]),
        float(readings[row, 1]),
        float(readings[row, 2]),
        float(readings[row, 3]),
    )
    return seen, float(readings[row, 4])


def recorded_disturbance(row: int, acting: Disturbance, values: Floats | None) -> Disturbance:
    """Return the disturbance in a state: the recorded values, or else the signals' ``acting``."""
    if values is None or len(values) == 0:
        return acting
    return Disturbance(
        float(values[row, 0]), float(values[row, 1]), float(values[row, 2]), float(values[row, 3])
    )


def stamp_at(row: int, regular_ns: int, stamps: Integers | None) -> int:
    """Return a row's stamp, ns."""
    return regular_ns if stamps is None or len(stamps) == 0 else int(stamps[row])


def scheduled(row: int, computed: float, values: Floats | None) -> float:
    """Return a row's value; the computed one where there is none, or NaN."""
    if values is None or len(values) == 0 or values[row] != values[row]:
        return computed
    return float(values[row])


def pushed(row: int, acting: Disturbance, push: Floats | None) -> Disturbance:
    """Return the disturbance with what an operator adds over the step from a row's state."""
    if push is None or len(push) == 0:
        return acting
    return with_operator(acting, Applied(float(push[row, 0]), float(push[row, 1])))


def wire_of(
    network: Network | None, states: int, command_index: Integers | None = None
) -> Wire | None:
    """Return the links of a run with so many states; None where every message arrives at once.

    ``command_index`` [states]: the step whose command is in force before the link, -1: none; None: the step's
    own.
    """
    if network is None and command_index is None:
        return None
    steps: Integers = np.arange(states)
    seen = used = steps
    if network is not None:
        traffic = Traffic(network)
        seen, used = traffic.measurement_steps(states), traffic.command_steps(states)
    if command_index is not None:
        used = np.where(used >= 0, command_index[np.maximum(used, 0)], -1)
    oldest = int((steps - seen).max(initial=0)), int((steps - used)[used >= 0].max(initial=0))
    return Wire(seen, used, np.zeros((oldest[0] + 1, 5)), np.zeros(oldest[1] + 1))


_QUIET = Disturbance()  # constants: numba's named tuples have no default values
_STILL = Hip()


# Nested pairs, ``(first, (second, ()))``: each law's constants have a different type.
Chain = tuple[Any, ...]


class Surroundings(NamedTuple):
    """What surrounds the controllers, from one change of parameters to the next."""

    plant: PlantConstants
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


class Instant(NamedTuple):
    """What is written down of one state."""

    trunk: PlantStatus  # as computed
    disturbance: Disturbance  # without what an operator does
    measured: Measurement
    measured_torque: float  # N m, the sensors' for the step before
    decision: Decision
    effort: float  # N m, what reaches the plant in the step that follows


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
    """Return that nobody answers."""
    return memories, Decision(0, False, 0.0, 0.0)


def decide_by(
    law: Law, place: int, others: Callable[..., Decided], tell: Tell
) -> Callable[..., Decided]:
    """Return a function that decides for a law's controller, at a place, and then for the ``others``.

    It takes the arguments of `decide_none`, and returns the next memories and the first active controller's
    answer. It writes that controller's update into the row.
    """
    update, transfer = law.update, law.transfer
    write_down = tell(law)
    bit = 1 << place

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
            own = participants[0]
            reading = reading_of(stamp_ns, measured, effort, own.hip, reference)
            after, a = decide(after, reading, own.settings, own.constants, update, transfer)
            if a.active and a.updated:
                write_down(out, row, a, measured)
            acted = Decision(bit if a.active else 0, a.updated, a.effort, a.reference)
        rest, other = others(
            memories[1], participants[1], stamp_ns, measured, effort, reference, reads, out, row
        )
        if acted.active == 0:
            return (after, rest), other
        both = acted.active | other.active
        return (after, rest), Decision(both, acted.updated, acted.effort, acted.reference)

    return first


# How a segment ends.
GOES_ON, FELL, DIVERGED = range(3)

# Writes one state into a row: ``keep(out, row, instant, plant)``.
Keep = Callable[[Floats, int, Instant, PlantConstants], None]


def segment_of(
    *laws: Law, dynamics: Dynamics, keep: Keep, tell: Tell
) -> Callable[..., tuple[int, int, LoopState]]:
    """Return the loop of a run of a plant with these laws, in the order of its participants, or without any.

    ``segment(first, stop, surroundings, state, participants, noise, history, schedule, out)`` computes the
    states with indices in [first, stop) and writes state k into row ``k - first`` of ``out``. It returns the
    index of the first state that it did not compute; why: `GOES_ON`, `FELL` (the run ends by a fall) or
    `DIVERGED` (the step to that state is not finite); and the loop's state there, for the next segment.

    ``noise`` [stop - first, 2] are standard normal samples; its last row is used for all that follow.
    ``history`` [delay_steps + 1, 4] keeps the states that the sensors still have to see.
    """
    forces, accelerations = dynamics
    decide_all: Callable[..., Decided] = decide_none
    for place, law in reversed(list(enumerate(laws))):
        decide_all = decide_by(law, place, decide_all, tell)

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
                after = act(trunk, effort, acting, s.plant, forces, accelerations)
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
            instant = Instant(computed, in_state, measured, measured_torque, acted, effort)
            keep(out, row, instant, s.plant)
            acting = pushed(row, in_state, given.push)
        return stop, GOES_ON, LoopState(trunk, memories, command, command_ns, begun, effort, acting)

    motion = accelerations.__module__, accelerations.__name__
    names = [*motion, keep.__name__, *(law.update.__module__ for law in laws)]
    segment.__name__ = segment.__qualname__ = "_".join(["segment", *names])
    return segment


def check(plan: RunPlan) -> None:
    """Raise PlanError for a plan that cannot be run without a graph.

    It needs an end, and nobody can publish references or activate a controller.
    """
    check_joints(plan)
    if not plan.simulator.duration:
        raise PlanError("simulator: duration is 0: an offline run needs an end; set it in s")
    for name, config in plan.controllers.items():
        changes = plan.changes.get(name, ())
        profiles: list[Value | None] = [config.reference_profile]
        profiles += [(change.values or {}).get("reference.profile") for change in changes]
        if "topic" in profiles and not plan.references:
            raise PlanError(
                f"{name}: reference.profile is 'topic', but nobody publishes references to an offline "
                "run: give another profile, or run the graph"
            )
        activated = any(change.event == Event.ACTIVATED for change in changes)
        if not (config.autostart or config.active_times or activated):
            raise PlanError(
                f"{name}: autostart is false, but nobody activates it in an offline run: "
                "set it to true, or run the graph"
            )


def disturbance_source(plan: RunPlan) -> Callable[[int], Disturbance]:
    """Return a function that returns the acting disturbance; its stamps must increase."""
    if plan.disturbance is None:
        quiet = Disturbance()
        return lambda stamp_ns: quiet
    timeline = plan.timeline("disturbance")
    signals = plan.disturbance.signals

    def acting(stamp_ns: int) -> Disturbance:
        nonlocal signals
        if timeline.advance(stamp_ns):
            signals = timeline.config.signals
        return disturbance_at(stamp_ns, signals)

    return acting


Seen = Callable[
    [str, int], float | None
]  # by controller and stamp in ns, the angle that it last saw
_QUIET_SIGNALS = Signals(0, (), 0, 0.0, 0, 0.0, 0.0, 0.0, 0, 0.0, (), (), 0, True, (), ())


def check_compilable(plan: RunPlan) -> None:
    """Raise PlanError for a plan that a batch's compiled loop, one segment a run, cannot model."""
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
    if plan.inputs is not None:
        raise PlanError("what the wall clock decided is not compiled: use simulate")


def states_of(plan: RunPlan) -> int:
    """Return the number of states of a plan's run to its end."""
    return step_count(plan.simulator.duration, plan.simulator.update_rate) + 1


def surroundings_of(
    simulator: SimulatorConfig,
    disturbance: DisturbanceConfig | None,
    wire: Wire | None = None,
    remembered: int = 0,
) -> Surroundings:
    """Return the controllers' surroundings while these configurations are in force."""
    return Surroundings(
        simulator.plant,
        simulator.sensor,
        _QUIET_SIGNALS if disturbance is None else disturbance.signals,
        disturbance is not None,
        simulator.delay_steps,
        remembered,
        simulator.period_ns,
        nanoseconds(simulator.command_timeout),
        simulator.fall_stop,
        wire,
    )


def for_compiler(surroundings: Surroundings) -> Surroundings:
    """Return the surroundings as compiled code takes them, of one type whatever is there and what is not."""
    s = surroundings
    sensor = s.sensor._replace(scale=s.sensor.scale or Scale())
    wire = s.wire or NO_WIRE
    return s._replace(
        plant=of_one_type(s.plant), sensor=sensor, signals=with_arrays(s.signals), wire=wire
    )


def participants_of(
    controllers: Iterable[tuple[ControllerConfig, Settings, Any]], joints: Sequence[str]
) -> Chain:
    """Return the participants with these configurations, settings and constants, in their order."""
    chain: Chain = ()
    for config, settings, constants in reversed(list(controllers)):
        hip = hip_index(config, joints)
        chain = (Participant(settings, constants, -1 if hip is None else hip), chain)
    return chain


def compiled_participants(controllers: Iterable[Controller], joints: Sequence[str]) -> Chain:
    """Return participants as compiled code takes them: tables are arrays, memories as they are."""
    return participants_of(
        (
            (
                c.config,
                with_arrays(c.settings)._replace(initial=c.settings.initial),
                tuple(map(with_arrays, c.constants)),
            )
            for c in controllers
        ),
        joints,
    )


def chain_of(values: Sequence[Any]) -> Chain:
    """Return values as nested pairs."""
    chain: Chain = ()
    for value in reversed(values):
        chain = (value, chain)
    return chain


def values_in(chain: Chain) -> Iterator[Any]:
    """Yield the values of nested pairs."""
    while chain:
        value, chain = chain
        yield value


def beginning(trunk: PlantStatus, memories: Chain) -> LoopState:
    """Return the loop before the first state."""
    return LoopState(trunk, memories, 0.0, 0, False, 0.0, _QUIET)


class PlannedSchedule:
    """What came from outside, by the plan: pushes, references by topic, given inputs."""

    def __init__(self, plan: RunPlan) -> None:
        self._period_ns = plan.simulator.period_ns
        self._references = plan.references
        self._operated = Operated(plan.pushes, plan.simulator.operator_limits)
        self._inputs = plan.inputs
        self._names = list(plan.controllers)
        self.seen: Seen | None = None if plan.inputs is None else self._angle

    def _angle(self, name: str, stamp_ns: int) -> float | None:
        return None if self._inputs is None else self._inputs.seen.get(stamp_ns)

    def __call__(self, first: int, stop: int) -> Schedule:
        """Return the schedule of the states with indices in [first, stop)."""
        schedule = Schedule()
        stamps = np.arange(first, stop) * self._period_ns
        if self._operated:
            schedule = schedule._replace(push=self._operated.over(stamps))
        if self._references:
            values = [self._references.get(at, np.nan) for at in stamps.tolist()]
            schedule = schedule._replace(reference=np.array(values))
        if (inputs := self._inputs) is not None and first < len(inputs):
            answered = [np.isin(stamps, inputs.answered.get(name, ())) for name in self._names]
            reads = np.array(answered, np.int64).reshape(-1, len(stamps))
            schedule = schedule._replace(
                disturbance=inputs.disturbance[first:stop],
                command=None if inputs.command is None else inputs.command[first:stop],
                reads=np.ascontiguousarray(reads.T),
            )
        return schedule


class NoiseRows:
    """The sensors' samples, many at a time, so that compiled code draws them."""

    _WINDOWS = 16

    def __init__(self, seed: int, length: int) -> None:
        self._seed = seed
        self._length = length * self._WINDOWS
        self._first = -1
        self._samples: Floats = np.zeros((1, 2))
        self._none: Floats = np.zeros((1, 2))

    def rows(self, first: int, stop: int, needed: bool) -> Floats:
        """Return the samples of the states in [first, stop), which must lie in one block of samples."""
        if not needed:
            return self._none
        begin = first - first % self._length
        if begin != self._first:
            self._first = begin
            self._samples = noise_samples(self._seed, self._length, begin)
        return self._samples[first - begin : stop - begin]
