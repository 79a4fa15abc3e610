"""A recorded run, taken up at one of its states: the nodes as they were before it, recomputed and checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.units import nanoseconds, seconds

from ..errors import PlanError
from ..plans.plan import RunPlan
from ..plans.timeline import Change
from ..recorded.plan import references_of, why_not_again
from ..recorded.run import RecordedRun, usable
from ..recorded.turns import idle_ns
from ..replay.as_written import pictures
from ..replay.attributable import shared_from_ns
from ..replay.driven import DrivenController, driven_controllers
from ..replay.gaps import absent_steps
from ..replay.missing import cut_off_ns, missed_from_ns, recorded_until_ns
from ..replay.real_time import replay_torques
from ..replay.replay import Checked, replay_controllers, replay_disturbance
from ..replay.replay_plant import PlantReplay
from ..replay.verdict import describe
from ..replay.verify import surveyed
from ..runs.offline import Begun


class Resumed(NamedTuple):
    """A run before the state with index ``first``.

    The plan has the configurations in force there, and what happens from there on. ``commands``: how many
    each controller has given before.
    """

    plan: RunPlan
    begun: Begun
    first: int
    stamp_ns: int
    commands: Mapping[str, int]


def state_at(run: RecordedRun, at: float) -> int:
    """Return the index of the first state at or after a time in s.

    Raises PlanError if the time is outside of the run, RecordingError for a run that cannot be taken up.
    """
    if reason := why_not_again(run):
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
    surveyed(run)
    if reason := _unsound(run, stamp_ns):
        raise _refused(run, stamp_ns, reason)
    driven = driven_controllers(run)
    plant = PlantReplay(run, stamp_ns)
    commands = dict.fromkeys(run.controllers, 0)
    for checked in _recomputed(run, driven, plant, stamp_ns):
        if checked.found:
            raise _refused(run, stamp_ns, describe(checked.found[0]))
        if checked.controller:
            commands[checked.controller] += checked.steps
    told = set(run.parameters) & set(usable())
    # Those that have not given a command yet also exist.
    driven |= {node: DrivenController(run, node) for node in told - set(driven)}
    driven = {node: driven[node] for node in run.parameters if node in driven}
    for one in driven.values():
        _bring(one, stamp_ns, run)
    effort, told_ns = _last_command(run, stamp_ns)
    begun = Begun(
        plant.resumed(),
        {name: one.controller for name, one in driven.items()},
        told_ns,
        effort,
        by_hand=True,
    )
    return Resumed(_plan(run, begun, driven, plant, stamp_ns), begun, first, stamp_ns, commands)


def _refused(run: RecordedRun, stamp_ns: int, reason: str) -> RecordingError:
    return RecordingError(
        f"{run.path}: it cannot be branched at t = {seconds(stamp_ns):g} s: it does not verify up to there: "
        f"{reason}"
    )


def _unsound(run: RecordedRun, stamp_ns: int) -> str:
    """Return why the record before a stamp is incomplete, or not as it was recorded."""
    if altered := run.recording.alterations():
        return f"altered: {altered[0]}"
    recorded_ns = recorded_until_ns(run)
    for what, from_ns in (
        ("two simulators or controllers, or one that was restarted", shared_from_ns(run)),
        ("states or answers are missing", missed_from_ns(run)),
        ("the end is cut off", cut_off_ns(run)),
        ("the recorder was inactive", None if recorded_ns is None else recorded_ns + 1),
    ):
        if from_ns is not None and from_ns < stamp_ns:
            return f"{what} from t = {seconds(from_ns):g} s"
    period_ns = run.config("simulator").period_ns
    truth = run.table(topics.GROUND_TRUTH).stamp_ns
    wanted = truth[truth <= stamp_ns]
    absent, from_ns = absent_steps(wanted, period_ns)
    if absent or wanted[-1] != stamp_ns:
        return f"states are missing from t = {seconds(from_ns):g} s"
    told = [topics.JOINT_STATES, *([topics.EFFORT_COMMAND] if run.exact else [])]
    for relative in told:
        lacking = np.setdiff1d(wanted[:-1], run.table(relative).stamp_ns)
        if relative == topics.EFFORT_COMMAND:
            lacking = np.setdiff1d(lacking, idle_ns(run))
        if len(lacking):
            return f"{relative}: none at t = {seconds(int(lacking[0])):g} s"
    return ""


def _recomputed(
    run: RecordedRun,
    driven: Mapping[str, DrivenController],
    plant: PlantReplay,
    stamp_ns: int,
) -> Iterator[Checked]:
    """Yield all that differs before a stamp, and in its state."""
    yield from replay_controllers(run, driven, stamp_ns - 1)
    if run.count(topics.DISTURBANCE) and "disturbance" in run.parameters:
        yield from replay_disturbance(run, stamp_ns - 1)
    if not run.exact:
        yield from replay_torques(run, stamp_ns)
    # The measurement at the stamp belongs to the branch: its bits follow from the state's.
    yield from plant


def _bring(driven: DrivenController, stamp_ns: int, run: RecordedRun) -> None:
    """Apply the changes up to a stamp to a controller; show the previous state to an inactive one."""
    driven.timeline.advance(stamp_ns, driven.controller)
    before = stamp_ns - run.config("simulator").period_ns
    state = driven.state(before)
    if state is not None and not driven.controller.active:
        driven.controller.see(before, state[0])


def _last_command(run: RecordedRun, stamp_ns: int) -> tuple[float, int]:
    """Return the last command before a stamp, N m, and the command's stamp; both 0 if there is none."""
    commands = run.table(topics.EFFORT_COMMAND)
    stamps = commands.stamp_ns[commands.stamp_ns < stamp_ns]
    if not len(stamps):
        return 0.0, 0
    last = int(stamps.max())
    return commands.get(last, "effort", 1)[0], last


def _plan(
    run: RecordedRun,
    begun: Begun,
    driven: Mapping[str, DrivenController],
    plant: PlantReplay,
    stamp_ns: int,
) -> RunPlan:
    """Return the plan from a stamp on, to the time that was planned, or else to the last state."""
    simulator = begun.simulation.config
    last = int(run.table(topics.GROUND_TRUTH).stamp_ns.max())
    changes: dict[str, list[Change]] = {name: one.timeline.to_come for name, one in driven.items()}
    changes["simulator"] = plant.to_come
    disturbance = None
    if "disturbance" in run.parameters:
        timeline = run.timeline("disturbance")
        timeline.advance(stamp_ns)
        disturbance = timeline.config
        changes["disturbance"] = timeline.to_come
    if "recorder" in run.parameters:
        recorder = run.config("recorder")
    else:
        recorder = RecorderConfig(controllers=tuple(driven), markers=bool(pictures(run)))
    return RunPlan(
        scenario=run.recording.provenance.get("scenario", ""),
        simulator=replace(simulator, duration=simulator.duration or seconds(last)),
        controllers={name: one.controller.config for name, one in driven.items()},
        disturbance=disturbance,
        recorder=recorder,
        namespace=run.recording.namespace,
        changes={name: some for name, some in changes.items() if some},
        references=references_of(run),
        pushes=run.operated.pushes,
    )
