"""The plan of a recorded run: what `simulate --like`, branches and other repeats run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Integers
from trunk_core.parameters.shared import RecorderConfig
from trunk_core.topics import Event
from trunk_core.units import seconds
from trunk_recording.provenance import unrepeatable
from trunk_recording.reader import RecordingError
from trunk_runs.nodes import CONTROLLERS, unknown_controllers
from trunk_runs.plan import RunPlan
from trunk_runs.timeline import GivenInputs

from .evidence import RecordedInputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trunk_control.reference import ReferenceConfig

    from .recorded_run import RecordedRun


def plan_of(run: RecordedRun, in_time: bool = False) -> RunPlan:
    """Return the plan of the recorded run, as many steps as were recorded, and what happened in it.

    ``in_time``: as if every message of a real-time run had come at once. Raises RecordingError if the
    recording lacks something that this needs.
    """
    if reason := why_not_again(run):
        raise RecordingError(f"{run.path}: it cannot be run again: {reason}")
    states = run.count(topics.GROUND_TRUTH)
    plan = _plan(run, run.controllers)
    if states > 1 or not plan.simulator.fall_stop:  # a fall ends it in the first state again
        duration = seconds((states - 1) * plan.simulator.period_ns)
        plan = replace(plan, simulator=replace(plan.simulator, duration=duration))
    return plan if in_time else replace(plan, inputs=given_inputs(run, states))


def plan_from(run: RecordedRun, states: int) -> RunPlan:
    """Return the plan of a run that is the recorded one for so many states, and goes on to its planned end.

    It has the controllers that have not acted yet, too. Raises RecordingError if the recording lacks
    something that this needs.
    """
    reference = run.config("reference") if "reference" in run.parameters else None
    plan = _plan(run, [name for name in run.parameters if name in CONTROLLERS], reference)
    planned, last_ns = plan.simulator.duration, int(run.table(topics.GROUND_TRUTH).stamp_ns.max())
    pictures = any(run.topic(name) in run.recording.topics for name in topics.PICTURES)
    return replace(
        plan,
        simulator=replace(plan.simulator, duration=planned or seconds(last_ns)),
        recorder=replace(plan.recorder, markers=pictures),
        external=run.external or None,
        inputs=given_inputs(run, states),
    )


def _plan(
    run: RecordedRun, controllers: Sequence[str], reference: ReferenceConfig | None = None
) -> RunPlan:
    """Return the plan by the parameters, the changes and an operator of a run."""
    disturbed = run.table(topics.DISTURBANCE).stamp_ns if "disturbance" in run.parameters else ()
    plan = RunPlan(
        scenario=run.recording.provenance.get("scenario", ""),
        simulator=run.config("simulator"),
        controllers={name: run.config(name) for name in controllers},
        disturbance=run.config("disturbance") if "disturbance" in run.parameters else None,
        recorder=RecorderConfig(controllers=tuple(controllers)),
        reference=reference,
        references=references_of(run),
        pushes=run.operated.pushes,
        disturbed_ns=int(min(disturbed, default=0)),
    )
    changes = {name: run.changes(name) for name in plan.configs}
    return replace(plan, changes={name: listed for name, listed in changes.items() if listed})


def given_inputs(run: RecordedRun, states: int) -> GivenInputs | None:
    """Return the first states' inputs that the record alone tells; None if all follows from the plan.

    Raises RecordingError if a controller that is not known gave a command that acted, or if some of what
    acted is not on record.
    """
    period_ns = run.config("simulator").period_ns
    stamps = np.arange(states) * period_ns
    inputs = RecordedInputs(run, stamps)
    if not (inputs.recorded or run.external):
        return None
    lost = np.flatnonzero(~inputs.command_known)
    if len(lost):
        raise _refused(
            run, f"what acted at t = {seconds(int(stamps[lost[0]])):g} s is not on record"
        )
    force = inputs.over(slice(None))
    answered: dict[str, Integers] = {}
    seen: dict[int, float] = {}
    measured, commands = run.table(topics.JOINT_STATES), run.table(topics.EFFORT_COMMAND)
    for name in run.judgeable:
        acted = run.process(name)
        assert acted is not None  # its parameters are on record
        if acted.until_ns is not None and acted.until_ns < states * period_ns:
            raise _refused(run, f"{name} was restarted")
        terms = run.table(topics.controller_state(name)).stamp_ns
        answered[name] = np.intersect1d(acted.stamps(commands), terms)
        place = measured.index(run.config(name).joint)
        for change in acted.changes:
            if change.event == Event.ACTIVATED and change.stamp_ns in measured:
                seen[change.stamp_ns] = measured.get(change.stamp_ns, "position")[place]
    known = np.concatenate([*answered.values(), [-1]])
    strange = np.flatnonzero(~np.isin(force.command_ns, known))
    if len(strange) and not run.external:
        at = seconds(int(stamps[strange[0]]))
        raise _refused(run, f"at t = {at:g} s a command of an unknown source acts")
    return GivenInputs(
        force.command_ns,
        force.disturbance,
        force.disturbance_ns,
        answered,
        run.table(topics.DISTURBANCE).stamp_ns,
        seen,
        force.command if run.external else None,
        _topic_references(run) if run.external else {},
    )


def _topic_references(run: RecordedRun) -> dict[int, float]:
    """Return the references of an external node, rad, by stamp."""
    table = run.table(topics.REFERENCE)
    values = table.column("position", run.config("simulator").joints[1])
    return dict(zip(table.stamp_ns.tolist(), values.tolist(), strict=True))


def _refused(run: RecordedRun, reason: str) -> RecordingError:
    return RecordingError(f"{run.path}: it cannot be run again: {reason}")


def why_not_again(run: RecordedRun, commanded: bool = False) -> str:
    """Return why a recorded run cannot be run again with the same bits; empty if it can be.

    ``commanded``: a controller of the project takes over from an external one.
    """
    if reason := unrepeatable(run.arithmetic):
        return reason
    states = run.count(topics.GROUND_TRUTH)
    if run.recording.damage and not states:
        return run.recording.damage[0]
    if run.external:
        gave = f"{run.external} gave its commands, which is not ours"
        missing = {"simulator"} - set(run.parameters)
        if ours := ", ".join(run.judgeable):
            return f"{gave}, and so did {ours}: branch the run before {ours} took over"
        if not commanded:
            return f"{gave}: trunk branch --controller NAME lets one of ours take over"
        return "no parameters of simulator recorded" if missing else ""
    if not run.controllers or not set(run.controllers) <= set(CONTROLLERS):
        return unknown_controllers(run.controllers) or "no controller was recorded"
    missing = {*run.controllers, "simulator"} - set(run.parameters)
    if missing:
        return f"no parameters of {', '.join(sorted(missing))} recorded"
    return "" if states else "no true states recorded"


def references_of(run: RecordedRun) -> dict[int, float]:
    """Return the controllers' references that came by topic and are in no parameter."""
    references: dict[int, float] = {}
    for name in run.controllers:
        by_topic = any(
            (change.values or {}).get("reference.profile") == "topic"
            for change in run.changes(name)
        )
        if by_topic or run.config(name).reference_profile == "topic":
            terms = run.table(topics.controller_state(name))
            values = terms.values("position")
            if len(terms) and values.shape[1]:
                references |= dict(zip(terms.stamp_ns.tolist(), values[:, 0].tolist(), strict=True))
    return references
