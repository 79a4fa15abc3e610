"""What is wrong with a recording, and where: first the file's structure, then its content."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from trunk_core import topics as names
from trunk_core.arrays import Integers
from trunk_core.parameters.declarations import ParameterError
from trunk_core.topics import Event
from trunk_core.units import period_ns as period_of
from trunk_core.units import seconds
from trunk_recording.joint_table import QUANTITIES, JointTable
from trunk_recording.mcap_file import ERROR, INFO, WARNING, Finding, Topic
from trunk_recording.provenance import NONE
from trunk_recording.reader import Ending, RecordingError
from trunk_recording.summary import structure
from trunk_runs.nodes import CONTROLLERS, NODES

from .recorded_run import RecordedRun

__all__ = ["ERROR", "INFO", "WARNING", "Finding", "findings"]

_EXAMPLES = 3  # places listed for one kind of finding on one topic
_GAP = 1.5  # periods between two messages: more is a gap
_LONGEST_PERIOD = 1e9  # s: a longer one is not a period
# What a run is recomputed from, and the quantities that this needs.
_NEEDED = {
    names.GROUND_TRUTH: QUANTITIES,
    names.JOINT_STATES: QUANTITIES,
    names.EFFORT_COMMAND: ("effort",),
    names.DISTURBANCE: ("position", "effort"),  # if there are any
}
_NEEDED_OF_A_ROBOT = {names.JOINT_STATES: ("position",), names.EFFORT_COMMAND: ("effort",)}
_OF_BOTH = (names.GROUND_TRUTH, names.JOINT_STATES, names.DISTURBANCE)  # joints


def findings(run: RecordedRun) -> list[Finding]:
    """Return all findings on a run; none of severity "error" or "warning" for a sound one.

    Raises RecordingError if it is not readable any more.
    """
    recording, path = run.recording, run.path
    problems: list[Finding] = []
    try:
        for file in recording.opened:
            problems += structure(file)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}: give a readable file") from None
    # The structure check has already reported what the scan says of damaged bytes, with their place.
    known = {finding.message for finding in problems}
    faulty = [file for file in recording.opened if file.warning in known]
    repeated = {text for f in faulty for text in (f.warning, f"{f.path.name}: {f.warning}")}
    foreign = recording.ending is Ending.FOREIGN
    problems += [
        Finding(WARNING if foreign and warning == recording.unfinished else ERROR, warning)
        for warning in recording.warnings
        if warning not in repeated
    ]
    problems += _provenance(run)
    problems += [
        Finding(ERROR, f"{part}: not as the recorder wrote it (digest)")
        for part in recording.alterations()
    ]
    try:
        problems += _evidence(run)
        problems += _content(run)
    except RecordingError as error:
        problems.append(Finding(ERROR, str(error).removeprefix(f"{path}: ")))
    return problems


def _evidence(run: RecordedRun) -> Iterator[Finding]:
    """Yield the findings that keep the run from being recomputed although every message is sound."""
    recording = run.recording
    if run.controllers and not run.events:
        yield Finding(WARNING, "no events: the run cannot be judged", run.topic(names.RUN_EVENTS))
    for node in sorted((run.parameters.keys() & NODES.keys()) - {"recorder"}):
        try:
            run.config(node)
        except ParameterError as error:
            yield Finding(WARNING, f"{node}: recorded parameters cannot be used: {error}")
    needed = {**(_NEEDED if not run.another_robot else _NEEDED_OF_A_ROBOT)}
    needed |= {names.controller_state(name): ("position",) for name in run.controllers}
    for relative, quantities in needed.items():
        topic = run.topic(relative)
        if topic not in recording.topics or not recording.topics[topic].readable:
            if run.controllers and relative != names.DISTURBANCE:
                reason = recording.topics[topic].unreadable if topic in recording.topics else ""
                why = f"not read: {reason}" if reason else "no messages"
                yield Finding(WARNING, f"{why}: the run cannot be recomputed", topic)
            continue
        try:
            joints, carried = _carried(run, relative)
        except RecordingError as error:
            yield Finding(ERROR, str(error).removeprefix(f"{recording.path}: "))
            continue
        for quantity in quantities:
            if quantity not in carried:
                text = f"no {quantity} in any message: the run cannot be recomputed"
                yield Finding(WARNING, text, topic)
        if relative in _OF_BOTH and len(joints) != 2 and not run.another_robot:
            text = f"{len(joints)} joints, not hip and trunk: the run cannot be recomputed"
            yield Finding(WARNING, text, topic)
        for node, joint in _told_joints(run, relative):
            if joint not in joints:
                text = f"no joint {joint!r}, which {node} names, only {', '.join(joints[:9])}"
                yield Finding(WARNING, f"{text}: the run cannot be recomputed", topic)


def _carried(run: RecordedRun, relative: str) -> tuple[Sequence[str], Sequence[str]]:
    """Return the joints and the quantities that a topic's messages carry.

    Of another robot and beside foreign nodes, only of those that are meant for our controllers or our plant.
    """
    if run.another_robot or run.external:
        table = run.table(relative)
        return table.names, [quantity for quantity in QUANTITIES if table.width(quantity)]
    name = run.topic(relative)
    run.recording.check_type(name, names.JOINT_STATE_TYPE)
    layouts = run.recording.topics[name].layouts
    carried = [q for q in QUANTITIES if any(getattr(layout, q) for layout in layouts)]
    return [*dict.fromkeys(joint for layout in layouts for joint in layout.name)], carried


def _told_joints(run: RecordedRun, relative: str) -> Iterator[tuple[str, str]]:
    """Yield the joints of a topic by the nodes' parameters, with the node."""
    if relative in _OF_BOTH:
        joints = run.parameters.get("simulator", {}).get("joints")
        for joint in joints if isinstance(joints, tuple) else ():
            yield "simulator", str(joint)
    if relative in (names.JOINT_STATES, names.EFFORT_COMMAND):
        for node in run.controllers:
            named = run.parameters.get(node, {}).get("joint")
            if isinstance(named, str):
                yield node, named


def _provenance(run: RecordedRun) -> Iterator[Finding]:
    recording = run.recording
    if not recording.provenance:
        yield Finding(WARNING, "no provenance: scenario, versions and mode are not known")
    elif recording.provenance.get("commit") == NONE:
        yield Finding(
            INFO,
            "its provenance names no commit: run from a git checkout, or from an image of docker/build.sh",
        )
    nodes = {name.rsplit("/", 1)[-1] for name in run.first_sets}
    wanted = {*run.controllers, *(() if run.another_robot else ("simulator",))}
    for missing in sorted(wanted - nodes):
        yield Finding(WARNING, f"no parameters of {missing}: the run cannot be rebuilt")
    truth = recording.topics.get(run.topic(names.GROUND_TRUTH))
    if run.another_robot:
        text = "another robot's states: the commands to it can be recomputed, its motion cannot"
        yield Finding(INFO, text, run.topic(names.JOINT_STATES))
    elif truth is None or not truth.count:
        yield Finding(WARNING, "no true states", run.topic(names.GROUND_TRUTH))
    if run.external and not run.controllers:
        text = f"torque from {run.external}: its terms were not recorded"
        yield Finding(INFO, text, run.topic(names.EFFORT_COMMAND))
    elif not run.controllers:
        yield Finding(WARNING, "no controller's ~/state: reference and gains are not known")


class _Steps(NamedTuple):
    """How a topic's stamps are to follow one another: the severity of what does not."""

    disorder: str
    gap: str | None = None  # None: gaps are not looked for
    period_ns: int | None = None  # None: not known
    of_plant: bool = False  # in its steps, from the first on

    def are_kept(self, topic: Topic) -> bool:
        """Return True if the scan of a topic has seen nothing else."""
        near = topic.longest_step_ns <= _GAP * (self.period_ns or 0)
        return topic.rising and (near or self.gap is None)


def _steps(run: RecordedRun, relative: str) -> _Steps:
    commands, state = relative == names.EFFORT_COMMAND, relative.removesuffix("/state")
    is_state = state != relative and state in run.controllers
    of_plant = relative in _OF_BOTH or (commands and run.exact)
    # In real time the latest state is answered: some states twice, some never.
    loose = (commands or is_state) and not run.exact
    # With several controllers, each one's commands are in order; together they need not be. Of references for
    # one state, as a hand gives them, the last counts.
    several = commands and len(run.controllers) > 1
    disorder = INFO if loose or several or relative == names.REFERENCE else WARNING
    theirs = run.another_robot and relative == names.JOINT_STATES
    if theirs or not (commands or is_state or of_plant):
        return _Steps(disorder)
    node = "simulator" if of_plant else state if is_state else run.controller or ""
    rate = run.parameters.get(node, {}).get("update_rate")
    rate = rate if isinstance(rate, float) else inf
    known = 1.0 / _LONGEST_PERIOD < rate < inf
    # Another robot's states are answered at its rate, up to the controller's own.
    period_ns = period_of(rate) if known and not run.another_robot else None
    return _Steps(disorder, WARNING if known and not loose else INFO, period_ns, of_plant)


def _content(run: RecordedRun) -> Iterator[Finding]:
    """Yield what is wrong with values and stamps; a topic that the scan found sound is not read again."""
    recording = run.recording
    steps = {
        name: _steps(run, run.relative(name))
        for name, topic in sorted(recording.topics.items())
        if topic.type == names.JOINT_STATE_TYPE and topic.readable
    }
    # Others' joints share another robot's topic: only what our controllers look at counts.
    theirs = run.topic(names.JOINT_STATES) if run.another_robot else ""
    again = [n for n in steps if n != theirs and not steps[n].are_kept(recording.topics[n])]
    tables = recording.tables(dict.fromkeys(again, ()))
    if theirs in steps:
        tables[theirs] = run.table(names.JOINT_STATES)
    for name, (disorder, gap, period_ns, of_plant) in steps.items():
        topic = recording.topics[name]
        if name != theirs and not (topic.finite and topic.is_uniform):
            yield from _numbers(run.joints(name), name)
        if name in tables:
            yield from _order(tables[name].stamp_ns, name, disorder)
        if of_plant and period_ns and (missing := (topic.first_stamp_ns or 0) // period_ns) > 0:
            at = f"{missing} at a period of {period_ns / 1e6:g} ms"
            text = f"steps are missing before this stamp: {at}"
            yield Finding(WARNING, text, name, topic.first_stamp_ns)
        if name in tables and gap is not None:
            for turn in _turns(run, run.relative(name), tables[name].stamp_ns):
                yield from _gaps(turn, name, period_ns, gap)


def _turns(run: RecordedRun, relative: str, stamp_ns: Integers) -> list[Integers]:
    """Return the stamps of each of a controller's turns; between them it publishes nothing."""
    controller, stamps = relative.removesuffix("/state"), np.unique(stamp_ns)
    ends = [
        change.stamp_ns
        for change in (run.changes(controller) if controller in CONTROLLERS else ())
        if change.event == Event.DEACTIVATED
    ]
    return np.split(stamps, np.searchsorted(stamps, sorted(ends), side="right"))


def _order(stamp_ns: Integers, topic: str, severity: str) -> Iterator[Finding]:
    steps = np.diff(stamp_ns)
    for rows, fault in (
        (np.flatnonzero(steps < 0), "the stamp is earlier than that of the message before it"),
        (np.flatnonzero(steps == 0), "the stamp appears twice"),
    ):
        yield from _places(severity, fault, topic, stamp_ns[rows + 1])


def _gaps(stamps: Integers, topic: str, period_ns: int | None, severity: str) -> Iterator[Finding]:
    """Yield the places where steps are missing, by the period or else the median distance of the stamps."""
    steps = np.diff(stamps)
    if not len(steps):
        return
    period = period_ns or int(np.median(steps))
    wide = np.flatnonzero(steps > _GAP * period)
    missing = np.rint(steps[wide] / period).astype(np.int64) - 1
    by = f"a period of {period / 1e6:g} ms{'' if period_ns else ', the median'}"
    for row, count in list(zip(wide.tolist(), missing.tolist(), strict=True))[:_EXAMPLES]:
        text = f"steps are missing after this stamp: {count} at {by}"
        yield Finding(severity, text, topic, int(stamps[row]))
    if len(wide) > _EXAMPLES:
        text = f"steps are missing in {len(wide)} places, {int(missing.sum())} in all at {by}"
        yield Finding(severity, text, topic, int(stamps[wide[0]]))


def _numbers(joints: JointTable, topic: str) -> Iterator[Finding]:
    for quantity in QUANTITIES:
        for name in joints.names if joints.width(quantity) else ():
            values = joints.column(quantity, name)
            rows = np.flatnonzero(~np.isfinite(values))
            if len(rows):
                fault = f"{quantity}[{name}] is {values[rows[0]]}"
                yield from _places(ERROR, fault, topic, joints.stamp_ns[rows])


def _places(severity: str, fault: str, topic: str, stamps: Integers) -> Iterator[Finding]:
    for stamp in stamps[:_EXAMPLES].tolist():
        yield Finding(severity, fault, topic, stamp)
    if len(stamps) > _EXAMPLES:
        last = seconds(int(stamps[-1]))
        text = f"{fault}: {len(stamps)} times in all, the last at t = {last:g} s"
        yield Finding(severity, text, topic, int(stamps[0]))
