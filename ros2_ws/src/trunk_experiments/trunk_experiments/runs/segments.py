"""A segment of a run: the closed loop compiled, where that pays and can be done, or as CPython runs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from trunk_control.controller import Controller
from trunk_msgs_util.compiled import compiled, reason_of, with_arrays
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.config import SimulatorConfig

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

# Runge-Kutta steps. Loading compiled code takes 0.7 s, and compiling it, once for each version, some seconds;
# it saves some ten microseconds in each.
WORTH_COMPILING = 40_000
ENDLESS_S = 600.0  # how long an endless run counts as


def worth_compiling(config: SimulatorConfig, first: int = 0) -> bool:
    """Return True for a run that is long enough to make up for loading a loop's compiled code.

    ``first``: the index of the state that it goes on from.
    """
    steps = (config.duration or ENDLESS_S) * config.update_rate - first
    return steps * config.substeps >= WORTH_COMPILING


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
    """Return the loop in CPython."""
    laws = [controller.law for controller in controllers]
    segment = segment_of(*laws, keep=keep_states, tell=write_terms)

    def code(first: int, stop: int, inputs: SegmentInputs) -> tuple[int, int, LoopState]:
        surroundings, state, controllers, *arrays = inputs
        chain = participants_of(
            ((c.config, c.settings, c.constants) for c in controllers),
            plan.simulator.joints,
        )
        return segment(first, stop, surroundings, state, chain, *arrays)

    return code


_compiled: dict[tuple[str, ...], Callable[..., tuple[int, int, LoopState]]] = {}


def _compiled_code(plan: RunPlan, inputs: SegmentInputs) -> Code:
    """Return the loop as compiled code, after a call that computes no state. Raises as `code_for` does."""
    import numba

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
            _compiled[laws] = compiled(segment)
            _compiled[laws](0, 0, *given(inputs))
        except numba.core.errors.NumbaError as error:
            reason = reason_of(error)
            raise PlanError(f"{', '.join(laws)}: not compilable: {reason}") from None
    segment = _compiled[laws]
    return lambda first, stop, inputs: segment(first, stop, *given(inputs))
