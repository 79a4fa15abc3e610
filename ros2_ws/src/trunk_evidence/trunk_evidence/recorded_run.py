"""`RecordedRun`: a recording, loaded once for everything that judges, measures, shows or repeats the run.

Then facts of a run, from its states and what acted on the plant: a fall, late steps, silence, links' losses.
An event is a log: no fact follows from one, apart from a controller's turns. The modules for planning, and
the plant, are imported only where they are needed: metrics do without them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Floats, Integers
from trunk_core.files import resolve_path
from trunk_core.parameters.declarations import ParameterError, Value, build
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.results import Count
from trunk_core.topics import EXTERNAL, Event
from trunk_core.units import LAST_STAMP_NS, NANOSECONDS, seconds
from trunk_msgs_util.source import ARRIVAL, NO_SOURCE, source_in
from trunk_recording.joint_table import QUANTITIES, Column, JointTable
from trunk_recording.provenance import FORMAT
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.schemas import ParameterChange, RunEvent

if TYPE_CHECKING:
    from trunk_runs.plan import RunPlan
    from trunk_runs.timeline import Change, Operated, Timeline
    from trunk_sim.plant import Plant

    from .evidence import Evidence
    from .senders import Process

IN_A_RUN = "run.mcap"  # the same in every run's folder


def place_of(path: Path) -> Path:
    """Return the file or folder that a recording goes by: of a run's file, the folder."""
    return resolve_path(path).parent if path.name == IN_A_RUN else resolve_path(path)


def name_of_run(path: Path) -> str:
    """Return a recording's name; empty for the root of all files.

    ``fig8/run.mcap`` and ``fig8`` give ``fig8``, so do ``run.mcap`` and ``.`` within that folder;
    ``mine.mcap`` gives ``mine``.
    """
    if path.suffix == ".mcap" and path.name != IN_A_RUN:
        return path.stem
    return place_of(path).name


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


_RUN = topics.RUN_EVENTS.rpartition("/")[0] + "/"
_ANOTHER_CLOCK = 3_600_000_000_000  # ns: no recorder misses the states of a whole hour and is used
EXACT_MODES = ("lockstep", "offline")  # every state is answered, and can be recomputed


class RecordedRun:
    """What a recording says about its run. Each part is read on first use and kept.

    Reading a part raises RecordingError for messages that cannot be read.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self._check_format()
        # Read at once: what of them cannot be read is among the recording's warnings.
        self.events: Sequence[RunEvent] = recording.events(self.topic(topics.RUN_EVENTS))
        self.parameter_messages: Sequence[ParameterChange] = recording.parameter_messages(
            self.topic(topics.RUN_PARAMETERS)
        )
        self._tables: dict[str, JointTable] = {}
        self._kept: dict[str, tuple[set[Column], JointTable]] = {}
        self._filled: dict[str, JointTable] = {}  # read with all others, not yet asked for
        self._configs: dict[str, Any] = {}
        self._processes: dict[str, list[Process]] = {}
        self._acted: dict[str, Process | None] = {}

    @classmethod
    def open(cls, path: str | Path, whole: bool = False) -> RecordedRun:
        """Open a recording, as `Recording.open` does. Raises RecordingError."""
        return cls(Recording.open(path, whole=whole))

    def _check_format(self) -> None:
        provenance = self.recording.provenance
        written = provenance.get("format", "none")
        if self.recording.sound and "mode" in provenance and written != FORMAT:
            raise RecordingError(
                f"{self.path} is of format {written!r:.20}, this version reads format {FORMAT!r}: "
                "record the run again, or read it with the version that wrote it"
            )

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
    def namespace(self) -> str:
        """The namespace of the run, as ``/robot``; empty for the root."""
        suffix = f"/{topics.GROUND_TRUTH}"
        names = (t.removesuffix(suffix) for t in self.recording.topics if t.endswith(suffix))
        return next(names, "")

    def topic(self, relative: str) -> str:
        """Return the absolute name of a topic or node; an absolute one is returned as it is.

        A node goes by its kind: ``pid/state`` is that topic of the PID even if the node has another name.
        """
        if relative.startswith("/"):
            return relative
        node, slash, rest = relative.partition("/")
        if not relative.startswith(_RUN):
            node = self.renamed.get(node, node)
        return f"{self.namespace}/{node}{slash}{rest}"

    def relative(self, name: str) -> str:
        """Return the name for which `topic` returns this one; it stays absolute outside of the run."""
        prefix = f"{self.namespace}/"
        if not name.startswith(prefix):
            return name
        node, slash, rest = name.removeprefix(prefix).partition("/")
        kind = next((kind for kind, own in self.renamed.items() if own == node), node)
        return f"{kind}{slash}{rest}"

    @cached_property
    def renamed(self) -> dict[str, str]:
        """The names of nodes by the kind of node that they report, where the two differ.

        A kind is left out if several nodes are of it, or if some node has its name.
        """
        prefix = f"{self.namespace}/"
        kinds: dict[str, set[str]] = {}
        known = {change.node for change in self.parameter_messages}
        for event in self.events:
            known.add(event.node)
            kind = event.values.get("kind") if event.message == Event.CONFIGURED else None
            if kind and event.node.startswith(prefix):
                kinds.setdefault(kind, set()).add(event.node.removeprefix(prefix))
        return {
            kind: min(own)
            for kind, own in kinds.items()
            if len(own) == 1 and prefix + kind not in known
        }

    @property
    def controller(self) -> str | None:
        """The node whose ``~/state`` was recorded; of several, the one with most messages."""
        counts = self._controllers
        return max(counts, key=lambda name: counts[name], default=None)

    @cached_property
    def controllers(self) -> Sequence[str]:
        """All nodes whose ``~/state`` was recorded, in the plan's order."""
        planned = self.recording.provenance.get("controller", "").split()
        return tuple(
            sorted(
                self._controllers,
                key=lambda name: planned.index(name) if name in planned else len(planned),
            )
        )

    @cached_property
    def _controllers(self) -> dict[str, int]:
        prefix, suffix = f"{self.namespace}/", "/state"
        return {
            self.relative(name).removesuffix(suffix): topic.readable
            for name, topic in self.recording.topics.items()
            if topic.readable and name.startswith(prefix) and name.endswith(suffix)
        }

    @cached_property
    def first_sets(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's first full set of parameters, by its fully qualified name."""
        first: dict[str, Mapping[str, Value]] = {}
        for event in self.parameter_messages:
            if event.new:
                first.setdefault(event.node, event.new)
        return first

    @cached_property
    def joined(self) -> Sequence[str]:
        """Controllers of the graph, planned or not: they published parameters and were configured."""
        up = {self.relative(e.node) for e in self.events if e.message == Event.CONFIGURED}
        return tuple(name for name in usable() if name in up and name in self.parameters)

    @cached_property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters at the start, by its kind, or else by its name in the run's namespace.

        Of several processes of a node they are those of the one that acted.
        """
        first = {self.relative(name): values for name, values in self.first_sets.items()}
        if not self.real_time:
            return first
        acting = {name: self.process(name) for name in first if len(self.processes(name)) > 1}
        own = {name: process.parameters for name, process in acting.items() if process}
        return {name: values for name, values in {**first, **own}.items() if values}

    @cached_property
    def sources_in_force(self) -> Mapping[str, int]:
        """The sources of all that acted in real time, the first to act first, and since which state, ns."""
        from .senders import sources_in_force

        with suppress(RecordingError):  # whoever needs these messages reports it
            return sources_in_force(self)
        return {}

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
            from .senders import sources_in_force

            with suppress(RecordingError):
                sources = sources_in_force(self, (0,))
                return bool(sources) and all(map(source_in, sources))
            return False
        from .evidence import acts

        stamps = self.recording.joints(self.topic(topics.EFFORT_COMMAND)).stamp_ns
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
            simulator.parameters if simulator else self.first_sets.get(self.topic("simulator"), {})
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
        truth = self.recording.topics.get(self.topic(topics.GROUND_TRUTH))
        first_ns = (truth and truth.first_stamp_ns) or 0
        return 0 if "simulator" in self.parameters and abs(first_ns) < _ANOTHER_CLOCK else first_ns

    def count(self, relative: str) -> int:
        """Return how many messages of a topic there are."""
        topic = self.recording.topics.get(self.topic(relative))
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
        topic = self.topic(relative)
        filled = self._is_filled(topic)
        table = self._filled.pop(topic) if filled else self.recording.joints(topic)
        table.topic = self.relative(topic)
        return table

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
        column = ("position", joints_of(self)[1])
        truth = self.series({topics.GROUND_TRUTH: [column]})[topics.GROUND_TRUTH]
        return truth.stamp_ns, truth.column(*column)

    @cached_property
    def fall(self) -> Fall | None:
        """The first state beyond the fall angle. Raises RecordingError for states that cannot be read."""
        return fall_of(self)

    @cached_property
    def operated(self) -> Operated:
        """What an operator did. Raises RecordingError for messages that cannot be read as such."""
        from .evidence import operated_of

        return operated_of(self)

    def joints(self, topic: str) -> JointTable:
        """Return a JointState topic's messages, its name relative or absolute.

        They are those of its table if that was read, and else not kept: all topics of an hour at
        1 kHz take more than 1 GiB.
        """
        kept = self._tables.get(self.relative(topic))
        return kept if kept is not None else self._read(topic)

    def joint_names(self, relative: str) -> Sequence[str]:
        """Return the names in a JointState topic's first message; none without messages."""
        return self.recording.joint_names(self.topic(relative))

    def series(self, wanted: Mapping[str, Collection[Column]]) -> dict[str, JointTable]:
        """Return columns of some JointState topics by increasing stamp, empty tables without messages.

        They are those of the tables that were read, or that `keep_series` keeps; the others are read in one
        pass and not kept.
        """
        for topic in wanted:
            if self._is_filled(self.topic(topic)):
                self.table(topic)
        known = {
            topic: self._tables[topic] if topic in self._tables else self._kept[topic][1]
            for topic, columns in wanted.items()
            if topic in self._tables
            or (topic in self._kept and set(columns) <= self._kept[topic][0])
        }
        names = {self.topic(topic): topic for topic in wanted if topic not in known}
        read = self.recording.tables({name: wanted[topic] for name, topic in names.items()})
        known |= {names[name]: table for name, table in read.items()}
        return {topic: self._counting(topic, known[topic]).by_stamp() for topic in wanted}

    def _counting(self, topic: str, table: JointTable) -> JointTable:
        """Return the messages that count in real time: of the plant, and of controllers that acted on it."""
        if not (self.real_time and self.count(topics.PLANT_INPUTS)):
            return table
        if topic in (topics.GROUND_TRUTH, topics.JOINT_STATES):
            processes = list(filter(None, [self.process("simulator")]))
        elif (node := topic.removesuffix("/state")) in self.judgeable:
            processes = [p for p in self.processes(node) if p.source in self.sources_in_force]
        else:
            return table
        if any(process.sent_all(table) for process in processes):
            return table
        rows = [np.zeros(0, np.int64), *(process.rows(table) for process in processes)]
        return table.rows(np.sort(np.concatenate(rows)))

    def keep_series(self, wanted: Mapping[str, Collection[Column]]) -> None:
        """Read columns of some JointState topics in one pass, and keep them alone for who asks `series`."""
        series = self.series(wanted)
        self._kept = {topic: (set(wanted[topic]), table) for topic, table in series.items()}

    def config(self, node: str) -> Any:
        """Return a node's configuration at the start.

        Raises RecordingError if none of ours is recorded, ParameterError if it cannot be used.
        """
        if node not in self._configs:
            from trunk_runs.nodes import NODES, config_class

            if node not in self.parameters or node not in NODES:
                raise RecordingError(
                    f"{self.path}: no parameters of {node} are recorded, or none of ours"
                )
            self._configs[node] = build(
                config_class(node, self.parameters[node]), self.parameters[node]
            )
        return self._configs[node]

    @property
    def plant(self) -> Plant | None:
        """The plant, if it is another one than the trunk. Raises as `config` does."""
        if PLANT_NAME not in self.parameters.get("simulator", {}):
            return None
        plant: Plant = self.config("simulator").kind
        return plant

    def of_drive(self, text: str) -> str:
        """Return a text about the drive, or its unit, in the words of the run's plant, if that is known."""
        with suppress(ParameterError, RecordingError):
            return text if self.plant is None else self.plant.of_drive(text)
        return text

    def parameter_changes(self, node: str) -> Sequence[ParameterChange]:
        """Return a node's changes in file order; in real time those of the process that acted."""
        if self.real_time:
            process = self.process(node)
            return process.changed if process else ()
        name = self.topic(node)
        return [c for c in self.parameter_messages if c.changed and c.node == name]

    def processes(self, node: str) -> list[Process]:
        """Return the processes that a node had, in the order of their events and parameters."""
        from .senders import processes_of

        if node not in self._processes:
            self._processes[node] = processes_of(self, node)
        return self._processes[node]

    def process(self, node: str) -> Process | None:
        """Return the process of a node that acted in the run; None if none is on record."""
        from .senders import acted

        if node not in self._acted:
            self._acted[node] = acted(self, node)
        return self._acted[node]

    def changes(self, node: str) -> list[Change]:
        """Return the changes in a node's process: see `Process.changes`."""
        process = self.process(node)
        return process.changes if process else []

    def timeline(self, node: str) -> Timeline:
        """Return a node's configuration at the start and its changes during the run."""
        from trunk_runs.timeline import Timeline

        return Timeline(self.config(node), self.changes(node))

    def plan(self) -> RunPlan:
        """Return the plan of the recorded run, as `repetition.plan_of` does."""
        from .repetition import plan_of

        return plan_of(self)


def usable() -> tuple[str, ...]:
    """Return the names of the controllers whose laws are known here."""
    from trunk_runs.nodes import CONTROLLERS

    return CONTROLLERS


_SILENT_S = 1.0  # at a run's end: a busy machine holds a controller up for less


class Fall(NamedTuple):
    """The first state beyond the fall angle in force there."""

    stamp_ns: int
    angle: float  # rad


class Late(NamedTuple):
    """Steps of a real-time run that were made without the answer to their state."""

    steps: Annotated[Count, "Late steps"]
    of: Annotated[Count, "All steps"]
    moved_deg: Annotated[float | None, "By how much at most the angle departs from lock-step"] = (
        None
    )


def joints_of(run: RecordedRun) -> tuple[str, str]:
    """Return the names of the hip's and the trunk's joint.

    Raises RecordingError for a run without true states, or whose true states have other joints.
    """
    names = run.joint_names(topics.GROUND_TRUTH)
    topic = run.topic(topics.GROUND_TRUTH)
    if run.another_robot:
        raise RecordingError(f"{run.path}: a robot that is not ours: its true states are not known")
    if not run.count(topics.GROUND_TRUTH):
        if run.recording.damage:
            damage = run.recording.damage[0].removeprefix(f"{run.path.name}: ")
            raise RecordingError(
                f"{run.path} is damaged, and no messages on {topic} can be read: {damage}; "
                "record the run again"
            )
        raise RecordingError(
            f"{run.path} has no messages on {topic}: record a run with the simulator in it"
        )
    declared = run.parameters.get("simulator", {}).get("joints")
    if isinstance(declared, tuple) and len(declared) == 2:
        joints = str(declared[0]), str(declared[1])
    elif {"hip", "trunk"} <= set(names) or len(names) < 2:
        joints = "hip", "trunk"
    else:
        joints = names[0], names[1]
    for name in joints:
        if name not in names:
            raise RecordingError(
                f"{run.path}: {topic} has no joint {name!r}, "
                f"only {', '.join(names)}: set the parameter joints to its names"
            )
    return joints


def fall_angles(run: RecordedRun, stamps: Integers) -> Floats | None:
    """Return the fall angle in force in each state, rad [N]; None without parameters, NaN for no number.

    A parameter that a recording of an earlier version lacks has its default.
    """
    if "simulator" not in run.parameters:
        return None
    angles = np.full(len(stamps), np.nan)  # where it is not known, nothing is beyond it
    first = run.parameters["simulator"].get("fall.angle")
    if first is None:
        from trunk_sim.config import TrunkSimulator

        first = TrunkSimulator().fall_angle
    settings = [(-1, first)]
    settings += [
        (change.stamp_ns, change.changed["fall.angle"])
        for change in run.parameter_changes("simulator")
        if "fall.angle" in change.changed
    ]
    for since_ns, angle in settings:
        known = isinstance(angle, float | int) and not isinstance(angle, bool)
        angles[stamps > since_ns] = angle if known else np.nan
    return angles


def fall_of(run: RecordedRun) -> Fall | None:
    """Return the first state beyond the fall angle; None if there is none, or it is not known.

    Raises RecordingError for states that cannot be read.
    """
    if not run.count(topics.GROUND_TRUTH) or run.another_robot:
        return None
    stamps, angles = run.angles
    limits = fall_angles(run, stamps)
    if limits is None:
        return None
    beyond = np.abs(angles) > limits
    if not beyond.any():
        return None
    row = int(np.argmax(beyond))
    return Fall(int(stamps[row]), float(angles[row]))


def not_judged(run: RecordedRun) -> tuple[str, ...]:
    """Return what is shown of a run although nothing recomputes it, a line each."""
    follow, lines = "the states follow from the commands", list[str]()
    if run.another_robot:
        lines.append("the states, and whether all are recorded: another robot published them")
    elif run.another_controller:
        names = ", ".join(run.controllers)
        lines.append(f"the commands and terms of {names}, another controller: {follow}")
    elif run.external:
        lines.append(f"the reference, commands and terms of {run.external}: {follow}")
    for name in (*run.judgeable, "disturbance") if run.real_time else ():
        process = run.process(name)
        if process is not None and process.until_ns is not None:
            since = f"t = {seconds(process.until_ns):g} s"
            lines.append(f"what another process of {name} sent from {since} on")
    return tuple(lines)


def links_of(run: RecordedRun) -> dict[str, str]:
    """Return what became of the messages on a run's links.

    Empty without links, if it is not known, and for a large file of which only the summary was read.
    """
    if not run.recording.checked or "simulator" not in run.parameters:
        return {}
    from trunk_sim.links import Traffic

    with suppress(RecordingError, ParameterError):
        network = run.config("simulator").network
        return {} if network is None else Traffic(network).counts(len(run.angles[0]))
    return {}


def silence_of(run: RecordedRun) -> str:
    """Return a clause if no command was in force in a run in real time, or none at its end; else nothing.

    Raises RecordingError for messages that cannot be read.
    """
    if not run.count(topics.PLANT_INPUTS) or "simulator" not in run.parameters:
        return ""
    stamps = run.evidence.stamps
    if len(stamps) < 2:
        return ""
    held = run.evidence.inputs.over(slice(0, len(stamps) - 1)).command_ns >= 0
    commanded = int(np.count_nonzero(held))
    silent = int(np.argmax(held[::-1])) if commanded else len(held)
    since_ns = int(stamps[len(held) - silent])
    if commanded and int(stamps[-1]) - since_ns <= _SILENT_S * NANOSECONDS:
        return ""
    names = run.acting or run.recording.provenance.get("controller", "").split()
    by = f" from {', '.join(names)}" if names else ""
    after = f" after t = {seconds(since_ns):g} s" if commanded else ""
    return f"no command{by} was in force{after} ({commanded} of {len(held)} steps)"


def late_steps(run: RecordedRun) -> Late | None:
    """Return how many steps were made without the answer to their state; None where time was exact.

    A step is in time if the command in force answers its state or, where a controller answers only some
    states, the last of those; and if the disturbance in force is that of its state. Both are on record.
    An external node that answers fewer states than there are has a rate of its own: it may be one state off.
    A command without a state's stamp is neither late nor in time.
    """
    copy = bool(run.exact and run.count(topics.PLANT_INPUTS))  # of a real-time run: without sources
    if not (run.real_time or copy) or "simulator" not in run.parameters:
        return None
    stamps, inputs = run.evidence.stamps, run.evidence.inputs
    rows = slice(max(len(stamps) - 1, 0))
    stamps, force = stamps[rows], inputs.over(rows)
    periods = {name: run.config(name).period_ns for name in run.judgeable}
    if copy and not run.external:
        periods[NO_SOURCE] = max(periods.values(), default=0)
    step_ns = run.config("simulator").period_ns
    every_ns = [
        _usual_gap_ns(run, step_ns)
        if name == NO_SOURCE and name not in periods
        else max(periods.get(name.partition("@")[0], 0), step_ns)
        for name in inputs.sources
    ]
    age_ns = stamps - force.command_ns
    late = (force.command_ns < 0) | (age_ns >= np.array(every_ns)[force.command_source])
    if run.external:
        late &= np.array([name != ARRIVAL for name in inputs.sources])[force.command_source]
        late &= (force.command_ns >= 0).any()
    if run.count(topics.DISTURBANCE):
        late |= force.disturbance_ns != stamps
    return Late(int(np.count_nonzero(late)), len(stamps))


def _usual_gap_ns(run: RecordedRun, step_ns: int) -> int:
    """Return how old an external command may be before it is late, ns, by the states that it answered."""
    stamps = np.unique(run.table(topics.EFFORT_COMMAND).stamp_ns)
    gaps = np.diff(stamps[(stamps >= 0) & (stamps % step_ns == 0)]) // step_ns
    usual = int(np.bincount(np.minimum(gaps, 10_000)).argmax()) if len(gaps) else 1
    return step_ns if usual <= 1 else (usual + 1) * step_ns
