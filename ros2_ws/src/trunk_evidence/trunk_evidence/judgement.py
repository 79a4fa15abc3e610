"""Does a recording follow from itself? It is run again from what it recorded, and compared."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Integers
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import ParameterError, declarations
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.text import shell_words
from trunk_core.topics import Event
from trunk_core.units import seconds, step_count
from trunk_recording.provenance import PACKAGE, another_version, packages_of_plugins, unrepeatable
from trunk_recording.reader import Recording, RecordingError
from trunk_runs.nodes import CONTROLLERS, NODES, config_class, unknown_controllers
from trunk_runs.plan import check_joints
from trunk_sim.config import SimulatorConfig
from trunk_sim.plant import PLANTS

from .evidence import acts
from .in_force import check_disturbances, check_inputs
from .recorded_run import RecordedRun, not_judged, silence_of
from .rerun import Rerun
from .senders import Process, is_whole
from .verdict import DIVERGES, UNJUDGED, VERIFIED, Check, Verdict, describe

__all__ = [
    "DIVERGES",
    "UNJUDGED",
    "VERIFIED",
    "Check",
    "Verdict",
    "describe",
    "verdict_on",
    "verify",
]

_MODES = {"real_time": "in real time", "lockstep": "in lock-step", "offline": "offline"}


def verify(recording: Recording) -> Verdict:
    """Return the verdict on a recording; damage and gaps make it inconclusive, and are never ignored."""
    return verdict_on(RecordedRun(recording))


def verdict_on(run: RecordedRun) -> Verdict:
    """Return the verdict on a recorded run, as `verify` does."""
    recording = run.recording
    run.read_whole()
    verdict = Verdict()
    with suppress(RecordingError, ParameterError):  # of the plant's inputs: met again below
        verdict.obstacles += filter(None, [silence_of(run)])
    verdict.obstacles += dict.fromkeys(
        filter(None, [recording.unfinished, *recording.further_warnings])
    )
    verdict.obstacles += recording.seen_otherwise
    verdict.altered = recording.alterations()
    verdict.notes += [run.branch.describe()] if run.branch else []
    verdict.notes += filter(None, [another_version(recording.provenance)])
    verdict.notes += _other_packages(run)
    verdict.notes += _signatures(recording)
    if uncovered := recording.undigested():
        verdict.obstacles.append(f"no digests of {', '.join(uncovered)}: an edit would not show")
    if reason := _unjudgeable(run):
        verdict.obstacles.append(reason)
        return verdict
    try:
        if run.count(topics.GROUND_TRUTH):
            _judge(run, verdict)
        else:
            _judge_robot(run, verdict)
        verdict.obstacles += [
            f"{check.name}: {check.reason}" for check in verdict.checks if check.reason
        ]
        verdict.obstacles += [
            f"{check.name}: {check.unjudged} of {check.unjudged + check.steps} steps not judged: "
            "what they need is not on record"
            for check in verdict.checks
            if check.unjudged and not check.reason
        ]
        verdict.unjudged += _unjudged(run)
    except ParameterError as error:
        verdict.obstacles.append(f"recorded parameters cannot be used: {error}")
    except RecordingError as error:
        verdict.obstacles.append(str(error).removeprefix(f"{recording.path}: "))
    verdict.notes += [f"{kind} is the node {run.topic(kind)}" for kind in sorted(run.renamed)]
    return verdict


def _signatures(recording: Recording) -> Iterator[str]:
    """Tell of each signature beside a recording what checks it: no verdict depends on one."""
    for path in recording.files:
        for signature in sorted({f"{path}.sig", str(path.with_suffix(".sig"))}):
            if os.path.lexists(signature):
                yield (
                    "a signature lies beside it, which is not judged here: ssh-keygen -Y verify -n trunk "
                    f"-f allowed_signers -I WHO -s {shell_words(signature)} < {shell_words(str(path))}"
                )


def _unjudgeable(run: RecordedRun) -> str:
    """Return why nothing of a run can be recomputed; empty if something can."""
    if not run.mode:
        return "no provenance: the mode of the run is not known"
    if reason := unrepeatable(run.arithmetic):
        return reason
    for relative in (topics.RUN_PARAMETERS, topics.RUN_EVENTS):
        if run.recording.unreadable(run.topic(relative)):
            return f"{relative} is not read: nothing can be judged without it"
    known = bool(run.controllers) and set(run.controllers) <= set(CONTROLLERS)
    strange = (run.real_time or bool(run.external)) and bool(run.count(topics.GROUND_TRUTH))
    if not (known or strange or run.another_controller):
        unknown = unknown_controllers(run.controllers)
        return unknown or "no known controller's state is recorded"
    if "simulator" in run.parameters and not run.count(topics.GROUND_TRUTH):
        return f"{topics.GROUND_TRUTH}: no messages, but a simulator of ours ran"
    plant = {"simulator"} if run.count(topics.GROUND_TRUTH) else set()
    disturbed = {"disturbance"} if run.count(topics.DISTURBANCE) and not run.real_time else set()
    laws = set(run.controllers) if known else set()
    missing = (plant | disturbed | laws) - set(run.parameters)
    return f"no parameters recorded of {', '.join(sorted(missing))}" if missing else ""


def _other_packages(run: RecordedRun) -> list[str]:
    """Return a line for each package of plug-ins that differs from the one that the run was recorded with.

    None where plant and controllers of the run are ours.
    """
    packages = [NODES[name].package if name in NODES else "" for name in run.controllers]
    if plant := run.parameters.get("simulator", {}).get(PLANT_NAME):
        packages.append(PLANTS.package_of(str(plant)) if plant in PLANTS.names else "")
    if {*packages} <= {"trunk_control", "trunk_sim"}:
        return []
    recorded = {n: v for n, v in run.recording.provenance.items() if n.startswith(PACKAGE)}
    here = packages_of_plugins() if recorded else {}
    return [
        f"{name}: recorded with {value}; here {here.get(name, 'it is not installed')}"
        for name, value in recorded.items()
        if here.get(name) != value
    ]


def _other_parameters(run: RecordedRun) -> Iterator[str]:
    """Yield parameters on record that no node has, or the other way round, as in another version."""
    for change in run.parameter_messages:
        node = run.relative(change.node)
        if node not in NODES or node == "recorder":
            continue
        declared = declarations(config_class(node, run.parameters.get(node, {})))
        fixed = [name for name in change.changed if name in declared and declared[name].fixed]
        if fixed:
            yield f"run/parameters: {node} changes {', '.join(fixed)}, which is fixed at start"
        if unknown := {*change.new, *change.changed} - set(declared):
            yield f"run/parameters: {node} has no parameters {', '.join(sorted(unknown))}"
        if change.new and (missing := set(declared) - set(change.new)):
            yield f"run/parameters: the set of {node} lacks {', '.join(sorted(missing))}"


def _judge(run: RecordedRun, verdict: Verdict) -> None:
    """Run the plant and its controllers again, and compare."""
    complete = (run.recording.end or {}).get("complete") == "true"
    rerun = Rerun(run)
    disturbance = run.config("disturbance") if "disturbance" in run.parameters else None
    plan = rerun.engine.plan
    try:
        check_joints(replace(plan, disturbance=disturbance))
    except PlanError as error:
        verdict.obstacles.append(str(error))
        hips = {controller.hip for controller in plan.controllers.values()} - {None}
        if not hips <= set(plan.simulator.joints):
            return  # no command can be computed
    rerun.compare()
    idle = {label: answers.check for label, answers in rerun.answers.items() if answers.idle}
    verdict.checks += [c for c in rerun.checks if all(c is not check for check in idle.values())]
    verdict.unjudged += [
        f"{label}: no command of this process is on record" for label in sorted(idle)
    ]
    rivals = _rivals(run, rerun)
    if rivals:
        verdict.obstacles.append(rivals)
        for check in rerun.checks:
            check.excuse(rivals)
    for line in _strangers(run, topics.JOINT_STATES):  # what a controller made of them is not known
        for check in (rerun.unattributed, *(answers.check for answers in rerun.answers.values())):
            check.excuse(line)
    for answers in rerun.answers.values():
        verdict.obstacles += (others := settle(run, answers.process, [answers.check]))
        for other in () if run.real_time else others:  # whose turns are not known
            rerun.unattributed.excuse(other)
        if (lacking := answers.lacking) is None:
            continue
        # A file that was cut may end with a command whose terms were still to come, and a controller that was
        # killed after the end may have taken its last terms with it.
        cut = not complete and lacking.stamp_ns >= answers.last_ns
        killed = run.mode != "offline" and not answers.process.published
        if is_whole(run, answers.process) and not cut and not killed:
            answers.check.note(lacking)
        else:
            verdict.obstacles.append(describe(lacking))
    if run.external and (check := _taken(run, rerun)).steps:
        verdict.checks.insert(0, check)
    ours = [rerun.plant, rerun.sensors, rerun.unattributed]
    verdict.obstacles += settle(run, rerun.simulator, ours)
    disturbing = run.process("disturbance") if run.count(topics.DISTURBANCE) else None
    if disturbing and disturbing.parameters:
        check = check_disturbances(run, disturbing)
        verdict.obstacles += settle(run, disturbing, [check])
        verdict.checks += [check] if check.steps else []
    if rerun.inputs.recorded:
        check = check_inputs(run, rerun)
        if not complete:
            check.excuse("messages are missing")
        verdict.checks.append(check)
    others = list(_other_parameters(run))
    verdict.obstacles += others
    for check in verdict.checks if others else ():
        check.excuse(others[0])
    verdict.obstacles += _wrong_end(rerun)
    verdict.obstacles += [] if complete else _recorder_was_inactive(run)
    verdict.obstacles += _missing(run, rerun)
    verdict.judged = _span(run, rerun)


def _judge_robot(run: RecordedRun, verdict: Verdict) -> None:
    """Judge the commands to a plant that is not ours, from the states that it published."""
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if len(commands):
        verdict.obstacles += (reasons := robot_obstacles(run))
        if not reasons:
            rerun = Rerun(run)
            rerun.compare()
            for answers in rerun.answers.values():
                verdict.obstacles += settle(run, answers.process, [answers.check])
            verdict.checks += rerun.checks
            span = seconds(int(np.ptp(commands)))
            verdict.judged = f"{len(commands)} commands in {span:g} s to a plant that is not ours"
    verdict.obstacles.append("no simulator of ours: its states come from elsewhere")


def _taken(run: RecordedRun, rerun: Rerun) -> Check:
    """Return a check that takes an external node's commands as they are: its law is not known."""
    check = Check(f"commands of {run.external}", taken=True)
    if not len(rerun.stamps):
        return check
    force = rerun.inputs.over(slice(None))
    ours = np.array(["@" in name for name in rerun.inputs.sources])[force.command_source]
    for name in run.judgeable if run.exact else ():
        ours |= acts(run, name, rerun.stamps)
    rows = np.flatnonzero((force.command_ns >= 0) & ~ours)
    check.add(rerun.stamps, rows, rows[:0], [])
    return check


def _rivals(run: RecordedRun, rerun: Rerun) -> str:
    """Return that two controllers gave commands in lock-step, where one must; empty if not.

    The plant took one of them, and the record does not say which.
    """
    senders = [event for event in run.events if event.message == Event.CONNECTED]
    # Of one sender the plant took the first answer to a state, and the record keeps its order.
    if run.mode != "lockstep" or (len(senders) == 1 and not rerun.answers):
        return ""
    stamps = np.sort(run.table(topics.EFFORT_COMMAND).stamp_ns)
    twice = stamps[1:][np.diff(stamps) == 0][:1].tolist()
    twice += [d.stamp_ns for d in rerun.unattributed.first if d.recorded > 1.0]
    if not twice:
        return ""
    return f"two controllers, or one that was restarted, from t = {seconds(min(twice)):g} s on"


def settle(run: RecordedRun, process: Process, checks: list[Check]) -> list[str]:
    """Hold a process to what it sent where all of that is here; return that another took its place."""
    others = _of_others(run, process)
    excuses = [] if run.real_time else [*others]  # in real time each message names its process
    if not is_whole(run, process):
        excuses.append(f"{process.node} did not say what it published, or not all of it is here")
    for check in checks:
        for excuse in excuses:
            check.excuse(excuse)
    return others


def _wrong_end(rerun: Rerun) -> list[str]:
    """Return that a run does not end with its duration, or with the fall that was to stop it."""
    config: SimulatorConfig = rerun.simulator.config
    if not len(rerun.stamps) or rerun.cut_ns is not None:
        return []
    last_ns, fall = int(rerun.stamps[-1]), rerun.run.fall if config.fall_stop else None
    at = f"the run ends at t = {seconds(last_ns):g} s"
    if fall is not None:
        stops = f"{at}, but fall.stop is set, and it fell at t = {seconds(fall.stamp_ns):g} s"
        return [] if last_ns == fall.stamp_ns else [stops]
    wanted = step_count(config.duration, config.update_rate)
    if not config.duration or int(rerun.evidence.index[-1]) == wanted:
        return []
    return [f"{at}, but its duration is {config.duration:g} s"]


def _span(run: RecordedRun, rerun: Rerun) -> str:
    stamps = rerun.stamps
    if not len(stamps):
        return "no state"
    first, last = (seconds(int(stamps[i])) for i in (0, -1))
    mode = _MODES.get(run.mode, f"mode {run.mode or 'unknown'}")
    return f"t = {first:g} to {last:g} s, {len(stamps)} states, {mode}"


def _missing(run: RecordedRun, rerun: Rerun) -> list[str]:
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
    known = {topics.JOINT_STATES: run.table(topics.JOINT_STATES).rows_of(states) >= 0}
    if rerun.inputs.recorded:
        known[topics.PLANT_INPUTS] = rerun.inputs.command_known
    else:
        known[topics.EFFORT_COMMAND] = rerun.inputs.command_known
        known[topics.DISTURBANCE] = rerun.inputs.disturbance_known
    for relative, there in known.items():
        lines += _absent(relative, int((~there).sum()), int(states[np.argmin(there)]))
    for node, relative in (("simulator", topics.JOINT_STATES), ("disturbance", topics.DISTURBANCE)):
        if process := run.process(node):
            lines += _disorder(relative, process.stamps(run.table(relative)))
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if len(rerun.answers) != 1:  # two controllers' messages may pass each other on their way
        commands = np.sort(commands)
    lines += _disorder(topics.EFFORT_COMMAND, commands) if run.exact else []
    if not rerun.answers and not run.another_controller and not run.external:
        lines.append(
            "no controller of ours gave the commands: they are judged by the plant's inputs alone"
        )
    return lines


def _of_others(run: RecordedRun, process: Process) -> list[str]:
    """Return that another process took a node's place: in lock-step no message names its process."""
    if process.until_ns is not None:
        since = f"t = {seconds(process.until_ns):g} s"
        return [f"{process.node}: another process acts from {since} on, which is not judged"]
    name = run.topic(process.node)
    sets = sum(bool(c.new) and c.node == name for c in run.parameter_messages)
    if run.mode != "lockstep" or sets < 2:
        return []
    return [f"{process.node} was restarted: what its processes sent cannot be told apart"]


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


def _strangers(run: RecordedRun, relative: str) -> list[str]:
    """Return, for a topic of a real-time run, that external nodes published on it."""
    if not run.real_time:
        return []
    table = run.table(relative)
    strange = [i for i, frame in enumerate(table.frames) if not run.is_ours(relative, frame)]
    count = int(np.isin(table.frame, strange).sum())
    return [f"{relative}: {count} messages of external nodes"] if count else []


def _unjudged(run: RecordedRun) -> list[str]:
    """Return the parts of this run that no check looks at."""
    lines = [
        *not_judged(run),
        *(
            f"{name}: its parameters are recorded, but it gave no command"
            for name in sorted(set(run.parameters) & set(CONTROLLERS) - set(run.controllers))
        ),
    ]
    if not run.exact:
        lines.append("when commands and disturbances arrived: the wall clock decides that")
    if not run.external:  # its commands have a row of their own
        lines += _strangers(run, topics.EFFORT_COMMAND)
    lines += _strangers(run, topics.DISTURBANCE)
    if any(run.topic(name) in run.recording.topics for name in topics.PICTURES):
        lines.append(f"the picture ({', '.join(topics.PICTURES)}): covered by digests alone")
    lines.append("the origin (scenario, commit, host, time): covered by digests alone")
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
    return [*lines, *_recorder_was_inactive(run)]


def _recorder_was_inactive(run: RecordedRun) -> list[str]:
    """Return that the recorder was inactive between two of the recorded messages; empty if it was not."""
    node, inactive = run.topic("recorder"), False
    for event in run.events:
        inactive |= event.node == node and event.message == Event.DEACTIVATED
        if inactive and event.node == node and event.message == Event.ACTIVATED:
            return ["the recorder was inactive for a while: what it missed is not known"]
    return []
