"""What the closed loop takes, from a plan: surroundings, participants, schedule, samples of noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from trunk_control.controller import hip_index
from trunk_control.controller_config import ControllerConfig
from trunk_control.decide import Settings
from trunk_msgs_util.compiled import with_arrays
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value
from trunk_msgs_util.recording.joint_table import Floats
from trunk_msgs_util.units import nanoseconds, step_count
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.noise import noise_samples
from trunk_sim.step import PlantStatus, Scale, of_one_type

from ..errors import PlanError
from ..plans.plan import RunPlan, check_joints, check_turns
from ..plans.pushes import Operated
from .loop import Chain, LoopState, Participant, Surroundings
from .schedule import NO_WIRE, Schedule, Wire


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
_QUIET = Disturbance()
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
