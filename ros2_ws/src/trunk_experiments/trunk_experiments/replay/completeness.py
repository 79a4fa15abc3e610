"""What of a run is not on record, not in order, or not looked at by any check."""

from __future__ import annotations

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_table import Integers
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS
from ..recorded.run import RecordedRun
from .rerun import Rerun
from .verdict import ORIGIN


def missing(run: RecordedRun, rerun: Rerun) -> list[str]:
    """Return the parts of the run that are not on record, or not in order, a line each."""
    lines = []
    states, period_ns = rerun.stamps, rerun.simulator.config.period_ns
    if rerun.cut_ns is not None:
        stamps = rerun.simulator.stamps(run.table(topics.GROUND_TRUTH))
        lines += _disorder(topics.GROUND_TRUTH, stamps) or [
            f"{topics.GROUND_TRUTH}: a stamp beyond the run or off its steps, t = {seconds(rerun.cut_ns):g} s"
        ]
    if not len(states):
        return [*lines, f"{topics.GROUND_TRUTH}: no messages"]
    last = int(states[-1]) // period_ns
    lines += _absent(topics.GROUND_TRUTH, last + 1 - len(states), _first_gap(states, period_ns))
    measured = run.table(topics.JOINT_STATES)
    known = {
        topics.JOINT_STATES: measured.rows_of(states) >= 0,
        topics.EFFORT_COMMAND: rerun.inputs.command_known,
        topics.DISTURBANCE: rerun.inputs.disturbance_known,
    }
    if rerun.inputs.recorded:
        known = {
            topics.JOINT_STATES: known[topics.JOINT_STATES],
            topics.PLANT_INPUTS: known[topics.EFFORT_COMMAND],
        }
    for relative, there in known.items():
        lines += _absent(relative, int((~there).sum()), int(states[np.argmin(there)]))
    for node, relative in (("simulator", topics.JOINT_STATES), ("disturbance", topics.DISTURBANCE)):
        for process in run.processes(node) if node in run.parameters else ():
            table = run.table(relative)
            lines += _disorder(relative, process.stamps(table))
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if len(rerun.answers) != 1:  # two controllers' messages may pass each other on their way
        commands = np.sort(commands)
    lines += _disorder(topics.EFFORT_COMMAND, commands) if run.exact else []
    if not rerun.answers and not run.another_controller and not run.external:
        lines.append(
            "no controller of ours gave the commands: they are judged by the plant's inputs alone"
        )
    return lines


def restarted(run: RecordedRun) -> dict[str, str]:
    """Return which nodes were restarted in lock-step, where their messages do not name their processes."""
    sets = [run.recording.relative(c.node) for c in run.recording.parameter_messages() if c.new]
    return {
        node: f"{node} was restarted: what its processes sent cannot be told apart"
        for node in sorted(set(sets))
        if run.mode == "lockstep" and sets.count(node) > 1
    }


def _first_gap(stamps: Integers, period_ns: int) -> int:
    """Return the first multiple of a period that is not among ascending stamps, ns."""
    gaps = np.flatnonzero(stamps != np.arange(len(stamps)) * period_ns)
    return int(gaps[0] if len(gaps) else len(stamps)) * period_ns


def _absent(relative: str, count: int, first_ns: int) -> list[str]:
    if not count:
        return []
    return [f"{relative}: {count} steps missing, the first at t = {seconds(first_ns):g} s"]


def _disorder(relative: str, stamps: Integers) -> list[str]:
    falls = np.flatnonzero(np.diff(stamps) <= 0)
    if not len(falls):
        return []
    before, after = (int(stamps[falls[0] + i]) for i in (0, 1))
    if after == before:
        return [f"{relative}: the stamp t = {seconds(after):g} s appears twice"]
    there_and_back = f"from t = {seconds(before):g} s to t = {seconds(after):g} s"
    return [f"{relative}: stamps go backwards, {there_and_back}"]


def strangers(run: RecordedRun, relative: str) -> list[str]:
    """Return, for a topic of a real-time run, that nodes of somebody else's published on it."""
    if not run.real_time:
        return []
    table = run.table(relative)
    strange = [i for i, frame in enumerate(table.frames) if not run.is_ours(relative, frame)]
    count = int(np.isin(table.frame, strange).sum())
    return [f"{relative}: {count} messages of somebody else's node"] if count else []


def unjudged(run: RecordedRun) -> list[str]:
    """Return the parts of this run that no check looks at."""
    lines = [
        f"{name}: its parameters are recorded, but it gave no command"
        for name in sorted(set(run.parameters) & set(CONTROLLERS) - set(run.controllers))
    ]
    if not run.exact:
        lines.append("when commands and disturbances arrived: the wall clock decides that")
    if not run.external:  # its commands have a row of their own
        lines += strangers(run, topics.EFFORT_COMMAND)
    lines += strangers(run, topics.DISTURBANCE)
    if any(run.recording.topic(name) in run.recording.topics for name in topics.PICTURES):
        lines.append(f"the picture ({', '.join(topics.PICTURES)}): covered by digests alone")
    if run.another_controller:
        lines.append(
            f"the commands and terms of {', '.join(run.controllers)}, another controller: "
            "the states follow from the commands"
        )
    lines.append(ORIGIN)
    return lines


def robot_obstacles(run: RecordedRun) -> list[str]:
    """Return why our commands to a robot cannot be recomputed."""
    lines = []
    states = run.table(topics.JOINT_STATES).stamp_ns
    unknown = np.setdiff1d(run.table(topics.EFFORT_COMMAND).stamp_ns, states)
    if len(unknown):
        lines.append(
            f"{len(unknown)} commands answer states that are not recorded: what followed from them is "
            "not known; start the recorder before the controller"
        )
    joints = sorted({run.config(name).joint for name in run.judgeable})
    if len(joints) > 1:
        lines.append(f"our controllers command several joints: {', '.join(joints)}")
    if states.min(initial=0) < 0:
        lines.append("states before t = 0: their order is not known")
    return [*lines, *recorder_was_inactive(run)]


def recorder_was_inactive(run: RecordedRun) -> list[str]:
    """Return that the recorder was inactive between two of the recorded messages; empty if it was not."""
    node, inactive = run.recording.topic("recorder"), False
    for event in run.events:
        inactive |= event.node == node and event.message == Event.DEACTIVATED
        if inactive and event.node == node and event.message == Event.ACTIVATED:
            return ["the recorder was inactive for a while: what it missed is not known"]
    return []
