"""A recorded run, taken up at one of its states: the nodes as they were before it, recomputed and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trunk_control.controller import Controller
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.units import nanoseconds, seconds

from ..errors import PlanError
from ..plans.plan import RunPlan
from ..plans.timeline import Change, Timeline, begins_active
from ..recorded.plan import references_of, why_not_again
from ..recorded.processes import Process
from ..recorded.run import RecordedRun, usable
from ..replay.checks import Check, describe
from ..replay.in_force import check_disturbances, check_inputs
from ..replay.rerun import Rerun
from ..replay.verify import fill_tables
from ..runs.engine import Checkpoint


class Resumed(NamedTuple):
    """A run before the state with index ``first``.

    The plan has the configurations in force there, and what happens from there on. ``sources``: of the nodes
    that go on, by name, in a real-time run. ``commander``: the controller that gave the last command.
    """

    plan: RunPlan
    checkpoint: Checkpoint
    first: int
    stamp_ns: int
    sources: Mapping[str, str]
    commander: str
    commands: Mapping[str, int]  # how many each controller has given before


def state_at(run: RecordedRun, at: float, commanded: bool = False) -> int:
    """Return the index of the first state at or after a time in s.

    ``commanded``: the branch names a controller of ours that takes over.

    Raises PlanError if the time is outside of the run, RecordingError for a run that cannot be taken up.
    """
    if reason := why_not_again(run, commanded):
        raise RecordingError(f"{run.path}: it cannot be branched: {reason}")
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    first, last = (seconds(int(stamps[i])) for i in (0, -1))
    if not (first <= at <= last):
        raise PlanError(f"--at {at:g}: outside the run, t = {first:g} to {last:g} s")
    period_ns: int = run.config("simulator").period_ns
    return -(-nanoseconds(at) // period_ns)


def resumed(run: RecordedRun, first: int) -> Resumed:
    """Return a run before its state with this index.

    Raises RecordingError if the record does not verify up to there.
    """
    stamp_ns = first * run.config("simulator").period_ns
    if run.mode == "real_time" and not run.sourced:
        raise _refused(
            run, stamp_ns, "it was recorded before runs recorded what acted on the plant"
        )
    fill_tables(run)
    if altered := run.recording.alterations():
        raise _refused(run, stamp_ns, f"altered: {altered[0]}")
    rerun = Rerun(run)
    _check_whole(run, rerun, stamp_ns)
    rerun.compare(stamp_ns - 1)
    checks = [*rerun.checks]
    for process in run.processes("disturbance") if run.count(topics.DISTURBANCE) else ():
        if process.parameters:
            checks.append(check_disturbances(run, process, stamp_ns - 1))
    if rerun.inputs.recorded:
        checks.append(check_inputs(run, rerun, stamp_ns - 1))
    faulty = [check for check in checks if check.first or check.unjudged]
    if faulty:
        earliest = min(
            faulty, key=lambda check: check.first[0].stamp_ns if check.first else stamp_ns
        )
        raise _refused(run, stamp_ns, _fault(earliest))
    checkpoint = rerun.engine.checkpoint()
    _check_state(run, rerun, checkpoint, stamp_ns)
    processes = _going_on(run, rerun, stamp_ns)
    controllers = {}
    for name in run.parameters:
        if name not in usable() or name not in processes:
            continue
        label = next((key for key, a in rerun.answers.items() if a.process is processes[name]), "")
        if label:
            controllers[name] = checkpoint.controllers[label]
        else:  # it has not given a command, but it exists
            controllers[name] = _idle(processes[name], run, stamp_ns)
    checkpoint = checkpoint._replace(controllers=controllers)
    sources = {name: process.source for name, process in processes.items()}
    plan = _plan(run, rerun, checkpoint, processes, stamp_ns)
    commands = {
        answers.process.node: answers.check.steps
        for answers in rerun.answers.values()
        if answers.process is processes.get(answers.process.node)
    }
    commander = _commander(run, processes, stamp_ns)
    return Resumed(plan, checkpoint, first, stamp_ns, sources, commander, commands)


def _fault(check: Check) -> str:
    return (
        describe(check.first[0])
        if check.first
        else f"{check.name}: {check.unjudged} steps not judged"
    )


def _refused(run: RecordedRun, stamp_ns: int, reason: str) -> RecordingError:
    return RecordingError(
        f"{run.path}: it cannot be branched at t = {seconds(stamp_ns):g} s: it does not verify up to there: "
        f"{reason}"
    )


def _check_whole(run: RecordedRun, rerun: Rerun, stamp_ns: int) -> None:
    """Raise RecordingError unless every state up to a stamp is there."""
    before = rerun.stamps[rerun.stamps <= stamp_ns]
    period_ns = run.config("simulator").period_ns
    gaps = np.flatnonzero(before != np.arange(len(before)) * period_ns)
    if len(gaps) or not len(before) or before[-1] != stamp_ns:
        at = seconds(int(gaps[0] if len(gaps) else len(before)) * period_ns)
        raise _refused(run, stamp_ns, f"states are missing from t = {at:g} s")


def _check_state(run: RecordedRun, rerun: Rerun, checkpoint: Checkpoint, stamp_ns: int) -> None:
    """Raise RecordingError unless the state at a stamp is the one that the run leads to."""
    check = rerun.check_state(checkpoint.state.trunk, stamp_ns)
    if check.first:
        raise _refused(run, stamp_ns, _fault(check))


def _going_on(run: RecordedRun, rerun: Rerun, stamp_ns: int) -> dict[str, Process]:
    """Return the process of each node that the branch goes on with: the last one configured before it."""
    going: dict[str, Process] = {"simulator": rerun.simulator}
    for name in run.parameters:
        for process in run.processes(name) if name not in ("simulator", "recorder") else ():
            began = [e.stamp_ns for e in process.events if e.message == Event.CONFIGURED]
            if process.parameters and (not began or began[0] < stamp_ns):
                going[name] = process
    return going


def _idle(process: Process, run: RecordedRun, stamp_ns: int) -> Controller:
    """Return a controller that has not answered any state before a stamp, but has seen them."""
    timeline = Timeline(process.config, process.changes)
    controller = Controller(process.config)
    if not begins_active(process.config, process.changes):
        controller.deactivate()
    timeline.advance(stamp_ns, controller)
    before_ns = stamp_ns - run.config("simulator").period_ns
    states = run.table(topics.JOINT_STATES)
    if not controller.active and before_ns in states:
        place = states.index(process.config.joint)
        controller.see(before_ns, states.get(before_ns, "position")[place])
    return controller


def _commander(run: RecordedRun, processes: Mapping[str, Process], stamp_ns: int) -> str:
    """Return the controller that gave the last command before a stamp; empty if none did."""
    last: dict[str, int] = {}
    for name, process in processes.items():
        if name in run.controllers:
            terms = run.table(topics.controller_state(name))
            stamps = process.stamps(terms)
            last[name] = int(stamps[stamps < stamp_ns].max(initial=-1))
    name = max(last, key=lambda name: last[name], default="")
    return name if last.get(name, -1) >= 0 else ""


def _plan(
    run: RecordedRun,
    rerun: Rerun,
    checkpoint: Checkpoint,
    processes: Mapping[str, Process],
    stamp_ns: int,
) -> RunPlan:
    """Return the plan from a stamp on, to the time that was planned, or else to the last state."""
    simulator, planned = checkpoint.simulator, rerun.simulator.config.duration
    last = int(run.table(topics.GROUND_TRUTH).stamp_ns.max())
    changes: dict[str, list[Change]] = {"simulator": rerun.engine.to_come().get("simulator", [])}
    disturbance = reference = None
    for name, process in processes.items():
        if name == "simulator":
            continue
        timeline = Timeline(process.config, process.changes)
        timeline.advance(stamp_ns)
        changes[name] = timeline.to_come
        if name == "disturbance":
            disturbance = timeline.config
        if name == "reference":
            reference = timeline.config
    if "recorder" in run.parameters:
        recorder = run.config("recorder")
    else:
        pictures = any(run.recording.topic(n) in run.recording.topics for n in topics.PICTURES)
        recorder = RecorderConfig(controllers=tuple(checkpoint.controllers), markers=pictures)
    return RunPlan(
        scenario=run.recording.provenance.get("scenario", ""),
        simulator=replace(simulator, duration=planned or seconds(last)),
        controllers={
            name: controller.config for name, controller in checkpoint.controllers.items()
        },
        disturbance=disturbance,
        recorder=recorder,
        namespace=run.recording.namespace,
        changes={name: later for name, later in changes.items() if later},
        references=references_of(run),
        pushes=run.operated.pushes,
        external=run.external or None,
        reference=reference,
    )
