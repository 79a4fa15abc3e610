"""A segment of a run: the closed loop compiled, where that pays and can be done, or as CPython runs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from trunk_control.controller import Controller
from trunk_msgs_util.compilable import with_arrays
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.simulation import act_for, plant_for, worth_compiling

from ..errors import PlanError
from ..plans.plan import RunPlan
from .loop import LoopState, Surroundings, segment_of
from .loop_inputs import for_compiler, participants_of
from .schedule import Schedule, of_one_type
from .states import keep_states, write_terms


class SegmentInputs(NamedTuple):
    """What a segment takes, as `loop.segment_of` has it, but controllers instead of participants."""

    surroundings: Surroundings
    state: LoopState
    controllers: Sequence[Controller]
    noise: Floats
    history: Floats
    schedule: Schedule
    out: Floats


Code = Callable[[int, int, SegmentInputs], tuple[int, int, LoopState]]


def code_for(plan: RunPlan, first: int, inputs: SegmentInputs, compiled: bool | None) -> Code:
    """Return the loop of a run from an index on: compiled, where that pays and can be done, or not.

    Raises PlanError for a law that cannot be ``compiled``, ImportError without numba.
    """
    if compiled or (compiled is None and worth_compiling(plan.simulator, first)):
        try:
            return _compiled_code(plan, inputs)
        except (ImportError, PlanError):  # numba is optional but faster
            if compiled:
                raise
    return _plain_code(plan, inputs.controllers)


def _plain_code(plan: RunPlan, controllers: Sequence[Controller]) -> Code:
    """Return the loop in CPython; in a long run, as where numba refuses a law, at least `act` is compiled."""
    step = act_for(plan.simulator)
    laws = [controller.law for controller in controllers]
    segment = segment_of(*laws, keep=keep_states, tell=write_terms, act=step)

    def code(first: int, stop: int, inputs: SegmentInputs) -> tuple[int, int, LoopState]:
        surroundings, state, controllers, *arrays = inputs
        chain = participants_of(
            ((c.config, c.settings, c.constants) for c in controllers),
            plan.simulator.joints,
        )
        plant = plant_for(step, surroundings.plant)
        return segment(first, stop, surroundings._replace(plant=plant), state, chain, *arrays)

    return code


_compiled: dict[tuple[str, ...], Callable[..., tuple[int, int, LoopState]]] = {}


def _compiled_code(plan: RunPlan, inputs: SegmentInputs) -> Code:
    """Return the loop as compiled code, after a call that computes no state. Raises as `code_for` does."""
    from trunk_msgs_util.compiled import NumbaError, ready, reason_of

    laws = tuple(controller.law.name for controller in inputs.controllers)

    def given(inputs: SegmentInputs) -> tuple[Any, ...]:
        surroundings, state, controllers, noise, history, schedule, out = inputs
        chain = participants_of(
            (
                (c.config, with_arrays(c.settings), tuple(map(with_arrays, c.constants)))
                for c in controllers
            ),
            plan.simulator.joints,
        )
        arrays = noise, history, of_one_type(schedule), out
        return for_compiler(surroundings), state, chain, *arrays

    if laws not in _compiled:
        loop = [controller.law for controller in inputs.controllers]
        segment = segment_of(*loop, keep=keep_states, tell=write_terms)
        try:
            _compiled[laws] = ready(segment, 0, 0, *given(inputs))
        except NumbaError as error:
            reason = reason_of(error)
            raise PlanError(f"{', '.join(laws)}: not compilable: {reason}") from None
    segment = _compiled[laws]
    return lambda first, stop, inputs: segment(first, stop, *given(inputs))
