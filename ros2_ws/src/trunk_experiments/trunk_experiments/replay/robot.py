"""Commands of our controllers to a plant that is not ours, recomputed from the states that it published."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trunk_control.controller_config import ControllerConfig
from trunk_control.decide import Reading
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.recording.joint_table import Bools, Floats, Integers
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.units import seconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.step import Measurement

from ..plans.plan import RunPlan
from ..recorded.run import RecordedRun
from ..runs.engine import Engine, RecordSource
from ..runs.loop import reading_of
from ..runs.schedule import Schedule
from ..runs.states import ACTIVE, EFFORT, FRESH, States
from .answers import Answers
from .checks import ComparedColumn, references
from .verdict import Verdict

NO_HIP = "hip"  # stands for the hip of controllers that use none


class RobotRerun:
    """Our controllers run again on another robot's states; its plant is not computed."""

    def __init__(self, run: RecordedRun) -> None:
        """Raise RecordingError and ParameterError for messages and parameters that cannot be used."""
        self.run = run
        self._measured = run.table(topics.JOINT_STATES)
        self.stamps: Integers = np.unique(self._measured.stamp_ns)
        processes = [p for name in run.judgeable for p in run.processes(name) if p.parameters]
        self.answers = {
            p.node if i == 0 else f"{p.node}, process {i + 1}": Answers(run, p, p.node, 0)
            for name in run.judgeable
            for i, p in enumerate(p for p in processes if p.node == name)
        }
        configs: list[ControllerConfig] = [
            answers.process.config for answers in self.answers.values()
        ]
        joint = configs[0].joint
        hip = next((config.hip for config in configs if config.hip is not None), NO_HIP)
        self._readings = _readings(run, self.stamps, joint, None if hip == NO_HIP else hip)
        plan = _plan(self, (hip, joint), len(self.stamps))
        self.engine = Engine(plan, RecordSource(self._given, self._seen, self.stamps))
        self._first, self._terms = 0, list[tuple[Bools, Floats]]()

    def _seen(self, label: str, stamp_ns: int) -> float | None:
        row = int(np.searchsorted(self.stamps, stamp_ns))
        if row == len(self.stamps) or self.stamps[row] != stamp_ns:
            return None
        return float(self._readings[row, 1])

    def _given(self, first: int, stop: int) -> Schedule:
        stamps = self.stamps[first:stop]
        self._terms = [answers.terms_at(stamps) for answers in self.answers.values()]
        answered = np.array(
            [answers.answered(stamps) for answers in self.answers.values()], np.int64
        )
        return Schedule(
            truth=np.zeros((len(stamps), 5)),
            measured=self._readings[first:stop],
            command=np.zeros(len(stamps)),
            reference=references(len(stamps), self._terms),
            reads=np.ascontiguousarray(answered.T),
            stamp_ns=stamps,
        )

    def compare(self) -> None:
        """Run, and compare."""
        for states in self.engine.states():
            self._take(states)

    def run_to(self, label: str, stamp_ns: int) -> bool:
        """Run up to the state before a stamp; return True: a robot's run is judged as a whole."""
        for states in self.engine.states(int(np.searchsorted(self.stamps, stamp_ns))):
            self._take(states)
        self.engine.take_effect()
        return True

    def reading(self, label: str, stamp_ns: int) -> Reading | None:
        """Return a measured state as a controller reads it; None if it is not on record."""
        row = int(np.searchsorted(self.stamps, stamp_ns))
        if row == len(self.stamps) or self.stamps[row] != stamp_ns:
            return None
        answers, values = self.answers[label], self._readings[row].tolist()
        place = -1 if answers.process.config.hip is None else 0
        reference = answers.reference(stamp_ns)
        return reading_of(stamp_ns, Measurement(*values[:4]), values[4], place, reference)

    def acting_at(self, stamp_ns: int) -> Disturbance:
        """Return that nothing is known to act."""
        return Disturbance()

    def _take(self, states: States) -> None:
        rows = slice(states.first, states.first + len(states.table))
        stamps, table = self.stamps[rows], states.table
        commands = self.run.table(topics.EFFORT_COMMAND)
        at = commands.rows_of(stamps)
        given = at >= 0
        efforts = np.where(given, commands.values("effort", 1)[at, 0], np.nan)
        effort = ComparedColumn(
            commands.topic, f"effort[{commands.names[0]}]", efforts, table[:, EFFORT]
        )
        active = table[:, ACTIVE].astype(np.int64)
        for place, answers in enumerate(self.answers.values()):
            mine = answers.answered(stamps) & answers.is_own(at)
            acts = (active >> place & 1) == 1
            fresh = table[:, FRESH] != 0.0
            answers.take(stamps, mine, given, acts, effort, fresh, self._terms[place], table)


def _plan(rerun: RobotRerun, joints: tuple[str, str], states: int) -> RunPlan:
    plant = SimulatorConfig(joints=joints)
    return RunPlan(
        scenario="",
        simulator=replace(plant, duration=seconds((states - 1) * plant.period_ns)),
        controllers={label: answers.process.config for label, answers in rerun.answers.items()},
        disturbance=None,
        recorder=RecorderConfig(),
        changes={label: answers.process.changes for label, answers in rerun.answers.items()},
    )


def _readings(run: RecordedRun, stamps: Integers, joint: str, hip: str | None) -> Floats:
    """Return hip and trunk as our controllers read them [N, 5]; 0 where a node goes on without a value."""
    table = run.table(topics.JOINT_STATES)
    rows = table.rows_of(stamps)
    values = np.zeros((len(stamps), 5))
    places = [(1, table.index(joint)), *([] if hip is None else [(0, table.index(hip))])]
    for column, place in places:
        values[:, column] = table.values("position")[rows, place]
        if table.width("velocity"):
            values[:, column + 2] = table.values("velocity")[rows, place]
    if table.width("effort"):
        values[:, 4] = table.values("effort")[rows, table.index(joint)]
    return np.where(np.isfinite(values), values, 0.0)


def judge_robot(run: RecordedRun, verdict: Verdict) -> None:
    """Judge the commands to a plant that is not ours, from the states that it published."""
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if len(commands):
        reasons = obstacles(run)
        verdict.obstacles += reasons
        if not reasons:
            rerun = RobotRerun(run)
            rerun.compare()
            verdict.checks += [answers.check for answers in rerun.answers.values()]
            span = seconds(int(np.ptp(commands)))
            verdict.judged = f"{len(commands)} commands in {span:g} s to a plant that is not ours"
    verdict.obstacles.append("no simulator of ours: its states come from elsewhere")


def obstacles(run: RecordedRun) -> Sequence[str]:
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


def explicable(run: RecordedRun) -> None:
    """Raise RecordingError where no command to a robot can be traced to its controller."""
    for reason in obstacles(run):
        raise RecordingError(f"{run.path}: {reason}")
