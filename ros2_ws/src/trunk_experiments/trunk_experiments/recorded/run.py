"""`RecordedRun`: a recording, loaded once for everything that judges, measures, shows or repeats the run.

The modules for planning are imported only where a recording is used as a plan: metrics do not need them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import ParameterError, Value, build
from trunk_msgs_util.recording.joint_table import QUANTITIES, Column, Floats, Integers, JointTable
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.recording.schemas import ParameterChange, RunEvent
from trunk_msgs_util.source import source_in
from trunk_msgs_util.topics import EXTERNAL
from trunk_msgs_util.units import LAST_STAMP_NS, seconds

if TYPE_CHECKING:
    from ..plans.plan import RunPlan
    from ..plans.pushes import Operated
    from ..plans.timeline import Change, Timeline
    from .evidence import Evidence
    from .facts import Fall
    from .processes import Process


# The keys of a branch's provenance.
OF, PARENT, AT, CHANGES = (
    "branch_of",  # SHA-256 of the parent's file
    "branch_parent",  # its name
    "branch_at",  # s
    "branch_changes",
)


class BranchOf(NamedTuple):
    """The run up to ``at`` s is the parent's; what follows was simulated, with these changes."""

    parent: Annotated[str, "The parent's file"]
    sha256: str
    at: Annotated[float, "Where it branches, s; up to there it is its parent"]
    changes: str

    def describe(self) -> str:
        """Return the parent and the changes in a line."""
        return (
            f"from t = {self.at:g} s on simulated with {self.changes}: "
            f"branch of {self.parent}, SHA-256 {self.sha256[:12]}…"
        )


def branch_of(provenance: Mapping[str, str]) -> BranchOf | None:
    """Return the parent of a run that is a branch; None if it is not one, or its time is not recorded."""
    try:
        at = float(provenance[AT])
        branch = BranchOf(provenance[PARENT], provenance[OF], at, provenance[CHANGES])
    except (KeyError, ValueError):
        return None
    return branch if 0.0 <= at <= seconds(LAST_STAMP_NS) else None


_ANOTHER_CLOCK = 3_600_000_000_000  # ns: no recorder misses the states of a whole hour and is used
EXACT_MODES = ("lockstep", "offline")  # every state is answered, and can be recomputed


class RecordedRun:
    """What a recording says about its run. Each part is read on first use and kept.

    Reading a part raises RecordingError for messages that cannot be read.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self._tables: dict[str, JointTable] = {}
        self._kept: dict[str, tuple[set[Column], JointTable]] = {}
        self._filled: dict[str, JointTable] = {}  # read with all others, not yet asked for
        self._configs: dict[str, Any] = {}
        self._processes: dict[str, list[Process]] = {}

    @classmethod
    def open(cls, path: str | Path, whole: bool = False) -> RecordedRun:
        """Open a recording, as `Recording.open` does. Raises RecordingError."""
        return cls(Recording.open(path, whole=whole))

    @property
    def path(self) -> Path:
        """The recording's file or folder."""
        return self.recording.path

    @property
    def mode(self) -> str:
        """``real_time``, ``lockstep``, ``offline``; empty if unknown."""
        return self.recording.provenance.get("mode", "")

    @property
    def exact(self) -> bool:
        """True if time was exact: every state was answered, and can be recomputed."""
        return self.mode in EXACT_MODES

    @property
    def real_time(self) -> bool:
        """True if messages name their processes, and the plant recorded its inputs: time was not exact."""
        return self.mode == "real_time"

    @cached_property
    def branch(self) -> BranchOf | None:
        """The parent of a run that is a branch; None for other runs."""
        return branch_of(self.recording.provenance)

    @property
    def arithmetic(self) -> str:
        """How its numbers were computed, by its provenance; empty if that does not say."""
        return self.recording.provenance.get("arithmetic", "")

    @cached_property
    def controllers(self) -> Sequence[str]:
        """All nodes whose ``~/state`` was recorded, in the plan's order."""
        return tuple(self.recording.controllers)

    @cached_property
    def joined(self) -> Sequence[str]:
        """Controllers of the graph, planned or not: they published parameters and were configured."""
        up = {self.recording.relative(e.node) for e in self.events if e.message == Event.CONFIGURED}
        return tuple(name for name in usable() if name in up and name in self.parameters)

    @cached_property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters at the start, by its kind, or else by its name in the run's namespace.

        Of several processes of a node they are those of the one that acted.
        """
        first = {
            self.recording.relative(name): values
            for name, values in self.recording.parameters().items()
        }
        if not self.real_time:
            return first
        acting = {name: self.process(name) for name in first if len(self.processes(name)) > 1}
        return first | {name: process.parameters for name, process in acting.items() if process}

    @cached_property
    def sources_in_force(self) -> Sequence[str]:
        """The sources of all that acted on the plant, the first to act first; none in simulated time."""
        from .processes import sources_in_force

        with suppress(RecordingError):  # whoever needs these messages reports it
            return sources_in_force(self)
        return ()

    @cached_property
    def external(self) -> str:
        """The name of the external controller whose commands the run has; empty if it has none.

        That is the name that the user gave, or else the node's own.
        """
        connected = [e.values.get("node", "") for e in self.events if e.message == Event.CONNECTED]
        if not connected or self._ours_alone:
            return ""
        planned = self.recording.provenance.get("controller", "").split()
        names = [name for name in planned if name not in usable()]
        names += [node.rpartition("/")[2] for node in connected]
        return next(filter(None, names), EXTERNAL)

    @cached_property
    def _ours_alone(self) -> bool:
        """True if each command that acted was of a controller of ours."""
        if self.real_time:
            from .processes import sources_in_force

            with suppress(RecordingError):
                sources = sources_in_force(self, (0,))
                return bool(sources) and all(map(source_in, sources))
            return False
        from .turns import acts

        stamps = self.recording.joints(self.recording.topic(topics.EFFORT_COMMAND)).stamp_ns
        ours = np.zeros(len(stamps), bool)
        with suppress(RecordingError, ParameterError):  # whoever needs them reports it
            for name in self.judgeable:
                ours |= acts(self, name, stamps)
        return len(ours) > 0 and bool(ours.all())

    @cached_property
    def acting(self) -> Sequence[str]:
        """The controllers by the names that a user knows, an external one included."""
        ours = [n for n in self.controllers if n in usable()] if self.external else self.controllers
        return (*ours, self.external) if self.external else tuple(ours)

    @cached_property
    def _taken(self) -> Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]:
        """The joints and quantities that a plant of ours gives or takes by topic; none without one."""
        # In real time its process is known before any messages, which other nodes' parameters are not.
        simulator = self.process("simulator") if self.real_time else None
        values = (
            simulator.parameters
            if simulator
            else self.recording.parameters().get(self.recording.topic("simulator"), {})
        )
        joints = values.get("joints")
        if not isinstance(joints, tuple) or len(joints) != 2:
            return {}
        hip, trunk = map(str, joints)
        return {
            topics.JOINT_STATES: ((hip, trunk), QUANTITIES),
            topics.DISTURBANCE: ((hip, trunk), ("position", "effort")),
            topics.EFFORT_COMMAND: ((trunk,), ("effort",)),
        }

    @cached_property
    def another_robot(self) -> bool:
        """True if a controller of ours moves another robot: there is no trace of our simulator."""
        ours = self.count(topics.GROUND_TRUTH) or "simulator" in self.parameters
        return not ours and bool(self.judgeable) and self.count(topics.JOINT_STATES) > 0

    @cached_property
    def another_controller(self) -> bool:
        """True if something other than a law gave an offline run's commands: they are the plant's inputs.

        A law has parameters on record, whether or not its package is installed here.
        """
        lawful = {*self.controllers} & {*self.parameters}
        commanded = self.mode == "offline" and bool(self.controllers)
        if lawful or not commanded or "simulator" not in self.parameters:
            return False  # without loading the laws, which metrics do not need
        return not set(usable()) & {*self.controllers, *self.parameters}

    @cached_property
    def judgeable(self) -> Sequence[str]:
        """The controllers whose laws and parameters are known."""
        return [n for n in self.controllers if n in usable() and n in self.parameters]

    @cached_property
    def begin_ns(self) -> int:
        """The stamp in ns at which t = 0: that of the first state, and 0 for our simulator's own time.

        States of an external node, or a run stamped anew, may have the wall clock's.
        Raises RecordingError for states that cannot be read, ParameterError for parameters.
        """
        if self.another_robot:
            return int(min(self.table(topics.JOINT_STATES).stamp_ns, default=0))
        truth = self.recording.topics.get(self.recording.topic(topics.GROUND_TRUTH))
        first_ns = (truth and truth.first_stamp_ns) or 0
        return 0 if "simulator" in self.parameters and abs(first_ns) < _ANOTHER_CLOCK else first_ns

    @cached_property
    def events(self) -> Sequence[RunEvent]:
        """The run's events in file order."""
        return tuple(self.recording.events())

    def count(self, relative: str) -> int:
        """Return how many messages of a topic there are."""
        topic = self.recording.topics.get(self.recording.topic(relative))
        return topic.count if topic else 0

    def table(self, relative: str) -> JointTable:
        """Return a JointState topic's table."""
        if relative not in self._tables:
            self._tables[relative] = self._meant(self._read(relative))
        return self._tables[relative]

    def read_whole(self) -> None:
        """Read all tables in one pass, for whoever judges the run; the others are read when needed."""
        with suppress(RecordingError):  # code that needs it meets the error again, and reports it
            self.recording.read_whole()

    def _is_filled(self, topic: str) -> bool:
        self._filled |= self.recording.filled()
        return topic in self._filled

    def _read(self, relative: str) -> JointTable:
        topic = self.recording.topic(relative)
        return self._filled.pop(topic) if self._is_filled(topic) else self.recording.joints(topic)

    def is_ours(self, relative: str, frame: str) -> bool:
        """Return False for a message of an external node, which has no source.

        A node that copies a state's whole header sends the simulator's source. In simulated time no message
        has one.
        """
        if not self.real_time:
            return not (self.external and relative == topics.EFFORT_COMMAND)
        source = frame.partition(" ")[0] if relative == topics.PLANT_INPUTS else frame
        copied = relative in (topics.EFFORT_COMMAND, topics.DISTURBANCE)
        return bool(source_in(source)) and not (
            copied and any(source == process.source for process in self.processes("simulator"))
        )

    def _meant(self, table: JointTable) -> JointTable:
        """Return the messages that nodes of ours took, by the sources that they have."""
        if table.topic == topics.JOINT_STATES:
            table = table.finite(self._needed)
        names, quantities = self._taken.get(table.topic, ((), ()))
        # What a stranger sent with other joints alone was refused: nobody used it.
        theirs = table.topic == topics.EFFORT_COMMAND and self.external
        if names and (theirs or table.names not in (names, ())):
            table = table.only(names, quantities)
        if self.real_time and table.topic in (topics.EFFORT_COMMAND, topics.DISTURBANCE):
            table.frames = tuple(
                frame if self.is_ours(table.topic, frame) else "" for frame in table.frames
            )
        return table

    @property
    def _needed(self) -> Sequence[Column]:
        """What our controllers need in another robot's states: they skip messages without it."""
        needed: set[Column] = set()
        for name in self.judgeable if self.another_robot else ():
            with suppress(ParameterError):
                config = self.config(name)
                joints = [joint for joint in (config.joint, config.hip) if joint is not None]
                needed |= {("position", joint) for joint in joints}
                if config.uses_rate:
                    needed |= {("velocity", joint) for joint in joints}
        return sorted(needed)

    @cached_property
    def evidence(self) -> Evidence:
        """Which messages count. Raises RecordingError and ParameterError where that cannot be told."""
        from .evidence import Evidence, RobotEvidence

        return (RobotEvidence if self.another_robot else Evidence)(self)

    @cached_property
    def angles(self) -> tuple[Integers, Floats]:
        """The stamps of the true states, ns [N], and the trunk's angle in them, rad [N].

        Raises RecordingError for a run without true states, or whose true states have other joints.
        """
        from .facts import joints_of

        column = ("position", joints_of(self)[1])
        truth = self.series({topics.GROUND_TRUTH: [column]})[topics.GROUND_TRUTH]
        return truth.stamp_ns, truth.column(*column)

    @cached_property
    def fall(self) -> Fall | None:
        """The first state beyond the fall angle. Raises RecordingError for states that cannot be read."""
        from .facts import fall_of

        return fall_of(self)

    @cached_property
    def operated(self) -> Operated:
        """What an operator did. Raises RecordingError for messages that cannot be read as such."""
        from .inputs import operated_of

        return operated_of(self)

    def joints(self, topic: str) -> JointTable:
        """Return a JointState topic's messages, its name relative or absolute.

        They are those of its table if that was read, and else not kept: all topics of an hour at
        1 kHz take more than 1 GiB.
        """
        kept = self._tables.get(self.recording.relative(topic))
        return kept if kept is not None else self._read(topic)

    def joint_names(self, relative: str) -> Sequence[str]:
        """Return the names in a JointState topic's first message; none without messages."""
        return self.recording.joint_names(self.recording.topic(relative))

    def series(self, wanted: Mapping[str, Collection[Column]]) -> dict[str, JointTable]:
        """Return columns of some JointState topics by increasing stamp, empty tables without messages.

        They are those of the tables that were read, or that `keep_series` keeps; the others are read in one
        pass and not kept.
        """
        for topic in wanted:
            if self._is_filled(self.recording.topic(topic)):
                self.table(topic)
        known = {
            topic: self._tables[topic] if topic in self._tables else self._kept[topic][1]
            for topic, columns in wanted.items()
            if topic in self._tables
            or (topic in self._kept and set(columns) <= self._kept[topic][0])
        }
        names = {self.recording.topic(topic): topic for topic in wanted if topic not in known}
        read = self.recording.tables({name: wanted[topic] for name, topic in names.items()})
        known |= {names[name]: table for name, table in read.items()}
        return {topic: self._counting(topic, known[topic]).by_stamp() for topic in wanted}

    def _counting(self, topic: str, table: JointTable) -> JointTable:
        """Return the messages that count in real time: of the plant, and of controllers that acted on it."""
        if not (self.real_time and self.count(topics.PLANT_INPUTS)):
            return table
        from .processes import simulator_of

        if topic in (topics.GROUND_TRUTH, topics.JOINT_STATES):
            processes = [simulator_of(self)]
        elif (node := topic.removesuffix("/state")) in self.judgeable:
            acted = self.sources_in_force
            processes = [p for p in self.processes(node) if p.parameters and p.source in acted]
        else:
            return table
        if any(process.sent_all(table) for process in processes):
            return table
        rows = [np.zeros(0, np.int64), *(process.rows(table) for process in processes)]
        return table.rows(np.sort(np.concatenate(rows)))

    def keep_series(self, wanted: Mapping[str, Collection[Column]]) -> None:
        """Read columns of some JointState topics in one pass, for all who ask `series` for them."""
        series = self.series(wanted)
        self._kept |= {topic: (set(wanted[topic]), table) for topic, table in series.items()}

    def config(self, node: str) -> Any:
        """Return a node's configuration at the start.

        Raises RecordingError if none of ours is recorded, ParameterError if it cannot be used.
        """
        if node not in self._configs:
            from ..plans.nodes import NODES

            if node not in self.parameters or node not in NODES:
                raise RecordingError(
                    f"{self.path}: no parameters of {node} are recorded, or none of ours"
                )
            self._configs[node] = build(NODES[node].config, self.parameters[node])
        return self._configs[node]

    def parameter_changes(self, node: str) -> Sequence[ParameterChange]:
        """Return a node's changes in file order; in real time those of the process that acted."""
        if self.real_time:
            process = self.process(node)
            return process.changed if process else ()
        name = self.recording.topic(node)
        return [change for change in self.recording.parameter_changes() if change.node == name]

    def processes(self, node: str) -> list[Process]:
        """Return the processes that a node had, in the order of their events and parameters."""
        from .processes import processes_of

        if node not in self._processes:
            self._processes[node] = processes_of(self, node)
        return self._processes[node]

    def process(self, node: str) -> Process | None:
        """Return the process of a node that acted in the run; None if none is on record."""
        from .processes import acted

        return acted(self, node)

    def changes(self, node: str) -> list[Change]:
        """Return the changes in a node's process: see `Process.changes`."""
        process = self.process(node)
        return process.changes if process else []

    def timeline(self, node: str) -> Timeline:
        """Return a node's configuration at the start and its changes during the run."""
        from ..plans.timeline import Timeline

        return Timeline(self.config(node), self.changes(node))

    def plan(self) -> RunPlan:
        """Return the plan of the recorded run, as `recorded.plan.plan_of` does."""
        from .plan import plan_of

        return plan_of(self)


def usable() -> tuple[str, ...]:
    """Return the names of the controllers whose laws are known here."""
    from ..plans.nodes import CONTROLLERS

    return CONTROLLERS
