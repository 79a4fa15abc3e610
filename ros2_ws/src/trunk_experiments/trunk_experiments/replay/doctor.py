"""What is wrong with a recording, and where: first the file's structure, then its content."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trunk_msgs_util import topics as names
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.provenance import NONE
from trunk_msgs_util.recording.joint_table import (
    QUANTITIES,
    Integers,
    JointTable,
)
from trunk_msgs_util.recording.mcap_file import ERROR, INFO, WARNING, Finding
from trunk_msgs_util.recording.reader import Ending, Recording, RecordingError
from trunk_msgs_util.recording.summary import structure
from trunk_msgs_util.units import period_ns as period_of
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS, NODES
from ..recorded.run import RecordedRun

__all__ = ["ERROR", "INFO", "WARNING", "Finding", "examine", "findings"]

_EXAMPLES = 3  # places listed for one kind of finding on one topic
_GAP = 1.5  # periods between two messages: more is a gap
_LONGEST_PERIOD = 1e9  # s: a longer one is not a period
# What a run is recomputed from, and the quantities that this needs.
_NEEDED = {
    names.GROUND_TRUTH: ("position", "velocity", "effort"),
    names.JOINT_STATES: ("position", "velocity", "effort"),
    names.EFFORT_COMMAND: ("effort",),
    names.DISTURBANCE: ("position", "effort"),  # if there are any
}
_NEEDED_OF_A_ROBOT = {names.JOINT_STATES: ("position",), names.EFFORT_COMMAND: ("effort",)}
_OF_BOTH = (names.GROUND_TRUTH, names.JOINT_STATES, names.DISTURBANCE)  # joints


def examine(
    path: str | Path, progress: Callable[[int, int], None] = lambda _done, _of: None
) -> list[Finding]:
    """Return all findings on an MCAP file or a rosbag2 folder; none of severity "error" or "warning"
    for a sound run.

    Raises RecordingError if the path does not exist or is not a recording at all.
    """
    return findings(RecordedRun(Recording.open(path, progress, whole=True)))


def findings(run: RecordedRun) -> list[Finding]:
    """Return all findings on a run that is open. Raises RecordingError if it is not readable any more."""
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
    content: list[Finding] = []
    try:
        roles, seen = _Roles.of(run), dict[str, JointTable]()
        for name, topic in sorted(recording.topics.items()):
            if topic.type != names.JOINT_STATE_TYPE or not topic.readable:
                continue
            if run.another_robot and name == recording.topic(names.JOINT_STATES):
                # Others' joints share the topic: only what our controllers look at counts.
                content += _order(run.table(names.JOINT_STATES).stamp_ns, name, WARNING)
            else:
                joints = run.joints(name)
                content += _joints(run, roles, name, joints)
                seen[name] = joints.rows(np.zeros(0, np.int64))  # an hour of all topics takes 2 GB
        content = [*_evidence(run, seen), *content]
    except RecordingError as error:
        content.append(Finding(ERROR, str(error).removeprefix(f"{path}: ")))
    problems += [
        Finding(ERROR, f"{part}: not as the recorder wrote it (digest)")
        for part in recording.alterations()
    ]
    return problems + content


def _evidence(run: RecordedRun, seen: Mapping[str, JointTable]) -> Iterator[Finding]:
    """Yield the findings that keep the run from being recomputed although every message is sound."""
    recording = run.recording
    if run.controllers and not run.events:
        yield Finding(
            WARNING, "no events: the run cannot be judged", recording.topic(names.RUN_EVENTS)
        )
    for node in sorted((run.parameters.keys() & NODES.keys()) - {"recorder"}):
        try:
            run.config(node)
        except ParameterError as error:
            yield Finding(WARNING, f"{node}: recorded parameters cannot be used: {error}")
    needed = {**(_NEEDED if not run.another_robot else _NEEDED_OF_A_ROBOT)}
    needed |= {names.controller_state(name): ("position",) for name in run.controllers}
    for relative, quantities in needed.items():
        topic = recording.topic(relative)
        if topic not in recording.topics or not recording.topics[topic].readable:
            if run.controllers and relative != names.DISTURBANCE:
                reason = recording.topics[topic].unreadable if topic in recording.topics else ""
                why = f"not read: {reason}" if reason else "no messages"
                yield Finding(WARNING, f"{why}: the run cannot be recomputed", topic)
            continue
        # Of another robot and beside foreign nodes, only what is meant for our controllers or our plant.
        meant = run.another_robot or run.external or topic not in seen
        try:
            table = run.table(relative) if meant else seen[topic]
        except RecordingError as error:
            yield Finding(ERROR, str(error).removeprefix(f"{recording.path}: "))
            continue
        for quantity in quantities:
            if not table.width(quantity):
                text = f"no {quantity} in any message: the run cannot be recomputed"
                yield Finding(WARNING, text, topic)
        if relative in _OF_BOTH and len(table.names) != 2 and not run.another_robot:
            text = f"{len(table.names)} joints, not hip and trunk: the run cannot be recomputed"
            yield Finding(WARNING, text, topic)
        for node, joint in _told_joints(run, relative):
            if joint not in table.names:
                text = f"no joint {joint!r}, which {node} names, only {', '.join(table.names[:9])}"
                yield Finding(WARNING, f"{text}: the run cannot be recomputed", topic)


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


class _Roles(NamedTuple):
    """Who publishes what, by absolute topic."""

    owners: dict[str, str]  # the controller of a ~/state
    by_simulator: frozenset[str]  # in the simulator's period
    commands: str

    @classmethod
    def of(cls, run: RecordedRun) -> _Roles:
        recording = run.recording
        return cls(
            {recording.topic(names.controller_state(name)): name for name in run.controllers},
            frozenset(
                recording.topic(name)
                for name in (
                    *(names.GROUND_TRUTH, names.JOINT_STATES, names.DISTURBANCE),
                    *([names.EFFORT_COMMAND] if run.exact else []),
                )
            ),
            recording.topic(names.EFFORT_COMMAND),
        )


def _provenance(run: RecordedRun) -> Iterator[Finding]:
    recording = run.recording
    if not recording.provenance:
        yield Finding(WARNING, "no provenance: scenario, versions and mode are not known")
    elif recording.provenance.get("commit") == NONE:
        yield Finding(
            INFO,
            "its provenance names no commit: run from a git checkout, or from an image of docker/build.sh",
        )
    nodes = {name.rsplit("/", 1)[-1] for name in recording.parameters()}
    wanted = {*recording.controllers, *(() if run.another_robot else ("simulator",))}
    for missing in sorted(wanted - nodes):
        yield Finding(WARNING, f"no parameters of {missing}: the run cannot be rebuilt")
    truth = recording.topics.get(recording.topic(names.GROUND_TRUTH))
    if run.another_robot:
        text = "another robot's states: the commands to it can be recomputed, its motion cannot"
        yield Finding(INFO, text, recording.topic(names.JOINT_STATES))
    elif truth is None or not truth.count:
        yield Finding(WARNING, "no true states", recording.topic(names.GROUND_TRUTH))
    if run.external and not run.controllers:
        text = f"torque from {run.external}: its terms were not recorded"
        yield Finding(INFO, text, recording.topic(names.EFFORT_COMMAND))
    elif not recording.controllers:
        yield Finding(WARNING, "no controller's ~/state: reference and gains are not known")


def _joints(run: RecordedRun, roles: _Roles, topic: str, joints: JointTable) -> Iterator[Finding]:
    yield from _numbers(joints, topic)
    owner = roles.owners.get(topic)
    is_state = owner is not None
    answers = is_state or topic == roles.commands
    # In real time the latest state is answered: some states twice, some never.
    loose = answers and not run.exact
    # With several controllers, each one's commands are in order; together they need not be. Of references for
    # one state, as a hand gives them, the last counts.
    several = topic == roles.commands and len(run.controllers) > 1
    by_hand = topic == run.recording.topic(names.REFERENCE)
    yield from _order(joints.stamp_ns, topic, INFO if loose or several or by_hand else WARNING)
    if answers or topic in roles.by_simulator:
        node = owner or run.recording.controller or ""
        node = "simulator" if topic in roles.by_simulator else node
        rate = run.parameters.get(node, {}).get("update_rate")
        known = isinstance(rate, float) and 1.0 / _LONGEST_PERIOD < rate < inf
        period_ns = period_of(rate) if isinstance(rate, float) and known else None
        if run.another_robot:  # at whose rate it answers, up to its own
            period_ns = None
        severity = WARNING if known and not loose else INFO
        if topic in roles.by_simulator and period_ns and len(joints):
            yield from _late(int(joints.stamp_ns.min()), topic, period_ns)
        for turn in _turns(run, owner, np.unique(joints.stamp_ns)):
            yield from _gaps(turn, topic, period_ns, severity)


def _turns(run: RecordedRun, controller: str | None, stamps: Integers) -> list[Integers]:
    """Return the stamps of each of a controller's turns; between them it publishes nothing."""
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


def _late(first_ns: int, topic: str, period_ns: int) -> Iterator[Finding]:
    """Yield a finding if a topic does not begin with the run, whose first state is at t = 0."""
    missing = first_ns // period_ns
    if missing > 0:
        text = (
            f"steps are missing before this stamp: {missing} at a period of {period_ns / 1e6:g} ms"
        )
        yield Finding(WARNING, text, topic, first_ns)


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
