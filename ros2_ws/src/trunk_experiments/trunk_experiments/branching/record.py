"""Records a branch: its past as the parent has it, then what its nodes do from there on."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trunk_msgs_util import provenance, topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.files import atomic_write, resolve_path
from trunk_msgs_util.parameters.declarations import declarations
from trunk_msgs_util.recording.interleaved import Rows
from trunk_msgs_util.recording.joint_table import Integers
from trunk_msgs_util.recording.mcap_file import McapFile
from trunk_msgs_util.recording.messages import Messages, unaligned
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.recording.schemas import parameter_event, parse_parameter_event
from trunk_msgs_util.recording.topic import STAMPED
from trunk_msgs_util.recording.writer import PROVENANCE, RecordingWriter
from trunk_msgs_util.source import process_id

from ..plans.nodes import NODES
from ..plans.plan import RunPlan
from ..recorded.run import AT, CHANGES, MADE_BY, OF, PARENT, RecordedRun
from ..runs.engine import Engine
from ..runs.offline_recording import OfflineRecorder, Progress, Within
from ..runs.states import FRESH, States
from .branch import Branch, Branched

Replaced = Mapping[str, Mapping[str, Any]]  # parameters with other initial values, by node


class Past:
    """The parent's messages stamped before a branch, those without a stamp by their log time."""

    def __init__(self, run: RecordedRun, stamp_ns: int, replaced: Replaced) -> None:
        self._run, self._stamp_ns, self._replaced = run, stamp_ns, replaced
        truth = run.table(topics.GROUND_TRUTH)
        self._last_ns = int(truth.stamp_ns.max())
        self._log_ns = int(truth.log_time_ns[truth.stamp_ns == stamp_ns][0])

    @property
    def ahead_ns(self) -> int:
        """By how much the log times are ahead of the stamps at the branch."""
        return self._log_ns - max(self._stamp_ns, 0)

    def copy(self, writer: RecordingWriter) -> None:
        """Write the messages. Raises RecordingError for a topic of a type that cannot be written."""
        recording = self._run.recording
        numbers: dict[str, int] = {}
        for name, topic in recording.topics.items():
            if self._began_later(name):
                continue
            try:
                numbers[name] = writer.channel(name, topic.type)
            except ValueError as error:
                raise RecordingError(
                    f"{recording.path}: {name} cannot be copied: {error}"
                ) from None
        for source, messages in recording.copies(list(recording.topics)):
            writer.write_rows(list(self._rows(source, messages, numbers)))

    def _began_later(self, name: str) -> bool:
        """Return True for a topic whose channel begins with its first message, if that comes later."""
        relative = self._run.recording.relative(name)
        own = relative == topics.OPERATOR_PUSH or topics.is_own_reference(relative)
        return own and not (self._run.table(relative).stamp_ns < self._stamp_ns).any()

    def _rows(
        self, source: McapFile, messages: Messages, numbers: Mapping[str, int]
    ) -> Iterator[Rows]:
        """Yield the messages of a block that belong to the past, in their order."""
        channels = messages.channels()
        before = self._before(source, messages, channels)
        parameters = self._run.recording.topic(topics.RUN_PARAMETERS)
        sizes = messages.end - messages.start
        for channel in np.unique(channels[before]).tolist():
            name = source.channels[channel].topic
            rows = np.flatnonzero(before & (channels == channel))
            size = int(sizes[rows[0]])
            if name != parameters and (sizes[rows] == size).all():
                data = unaligned(messages.data, f"V{size}")[messages.start[rows]]
                yield Rows(numbers[name], rows, messages.log_time_ns[rows], data)
                continue
            for row in rows.tolist():
                message = messages.data[int(messages.start[row]) : int(messages.end[row])]
                if name == parameters:
                    message = self._parameters(message)
                data = np.frombuffer(message, f"V{len(message)}")
                at = np.array([row])
                yield Rows(numbers[name], at, messages.log_time_ns[at], data)

    def _before(self, source: McapFile, messages: Messages, channels: Integers) -> Any:
        stamps = source.stamps(messages)
        stamped = [c for c in np.unique(channels).tolist() if source.type_of(c) in STAMPED]
        known = np.isin(channels, stamped)
        before = np.where(known, stamps < self._stamp_ns, messages.log_time_ns < self._log_ns)
        if self._run.external:  # a stamp of no state says nothing about when its command acted
            commands = self._run.recording.topic(topics.EFFORT_COMMAND)
            given = [c for c, channel in source.channels.items() if channel.topic == commands]
            period_ns = self._run.config("simulator").period_ns
            odd = np.isin(channels, given) & ((stamps <= 0) | (stamps % period_ns != 0))
            odd |= np.isin(channels, given) & (stamps > self._last_ns)
            before = np.where(odd, messages.log_time_ns < self._log_ns, before)
        # Sets of parameters are stamped 0 and belong to any past, unlike changes at that time.
        name = self._run.recording.topic(topics.RUN_PARAMETERS)
        for row in np.flatnonzero(~before & (stamps == 0)).tolist():
            if source.channels[int(channels[row])].topic == name:
                data = messages.data[int(messages.start[row]) : int(messages.end[row])]
                before[row] = bool(parse_parameter_event(data).new)
        return before

    def _parameters(self, data: bytes) -> bytes:
        """Return a message on ``run/parameters``, with other values where the branch begins with them."""
        change = parse_parameter_event(data)
        node = self._run.recording.relative(change.node)
        if not change.new or node not in self._replaced:
            return data
        kinds = {name: d.kind for name, d in declarations(NODES[node].config).items()}
        new = {**change.new, **self._replaced[node]}
        return parameter_event(change.stamp_ns, change.node, new, {}, kinds, change.source)


def record_branch(
    run: RecordedRun,
    branch: Branch,
    branched: Branched,
    path: Path,
    overwrite: bool = False,
    progress: Progress = lambda done, of: None,
) -> int:
    """Write the recording of a branch; return the number of its states, those of its past among them.

    Raises DivergedError (the file then ends, marked incomplete, with the last finite state), RecordingError
    for a parent that cannot be copied, and OSError.
    """
    resumed = branched.resumed
    plan = resumed.plan
    duration = {"duration": plan.simulator.duration}
    planned = run.config("simulator").duration
    replaced = {"simulator": duration} if planned not in (0.0, plan.simulator.duration) else {}
    past = Past(run, resumed.stamp_ns, replaced)
    with atomic_write(path, overwrite=overwrite) as part, RecordingWriter(part) as writer:
        writer.add_metadata(PROVENANCE, _origin(run, branch, plan))
        past.copy(writer)
        recorder = _BranchRecorder(run, branched, writer, past.ahead_ns)
        if not planned and not replaced:
            recorder.at_end = "stopped on request"
        recorder.introduce()
        diverged = recorder.write_all(Engine(plan, resumed.checkpoint).states(), progress)
    if diverged is not None:
        raise diverged
    return recorder.states


def digest_of(files: Iterable[Path]) -> str:
    """Return the SHA-256 of some files, one after the other, in hexadecimal digits."""
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while chunk := file.read(1 << 20):
                digest.update(chunk)
    return digest.hexdigest()


def _origin(run: RecordedRun, branch: Branch, plan: RunPlan) -> dict[str, str]:
    """Return the parent's origin, and whose branch this is."""
    here = provenance.gather()
    origin = {
        OF: digest_of(run.recording.files),
        PARENT: resolve_path(run.path).name,
        AT: repr(branch.at),
        CHANGES: branch.describe(),
        MADE_BY: f"trunk_experiments {here['trunk_experiments']}, commit {here['commit']}",
    }
    if run.mode == "offline":
        origin["controller"] = " ".join(plan.controllers)
    return {**run.recording.provenance, "mcap": here["mcap"], **origin}


class _BranchRecorder(OfflineRecorder):
    """Records what follows; the nodes of a graph say more than those of an offline run."""

    def __init__(
        self, run: RecordedRun, branched: Branched, writer: RecordingWriter, ahead_ns: int
    ) -> None:
        resumed, state = branched.resumed, branched.resumed.checkpoint.state
        held = None
        if run.real_time:
            since_ns = state.command_ns if resumed.commander else -1
            held = state.command, since_ns, resumed.commander
        within = Within(resumed.first, ahead_ns, run.recording.topic, self._source_of, held)
        self._run, self._resumed, self._new = run, resumed, branched.new
        super().__init__(resumed.plan, tuple(resumed.plan.controllers), writer, within)
        self._graph = run.mode != "offline"
        self._commands = Counter(resumed.commands)
        self._updates = Counter(
            {name: self._sent(topics.controller_state(name), name) for name in run.controllers}
        )
        self._silent = {
            run.recording.relative(event.node)
            for event in run.events
            if event.message in (Event.PUBLISHED, Event.CLEANED_UP)
            and event.stamp_ns < resumed.stamp_ns
        }

    def _source_of(self, node: str) -> str:
        """Return the source of a node's messages: its process's in the parent, or else this one."""
        if not self._run.real_time:
            return ""
        return self._resumed.sources.get(node) or f"{node}@{process_id()}"

    def _sent(self, topic: str, node: str) -> int:
        """Return how many messages a node's process sent on a topic before the branch."""
        table = self._run.table(topic)
        rows: Integers = np.arange(len(table))
        for process in self._run.processes(node):
            if process.source == self._resumed.sources.get(node, ""):
                rows = process.rows(table)
        return int((table.stamp_ns[rows] < self._resumed.stamp_ns).sum())

    def introduce(self) -> None:
        """Write the parameters of nodes that the parent does not have; in a graph, also that they came up."""
        for node, config in self._new.items():
            self.put_parameters(node, config)
            if self._graph:
                values = {"process": process_id(), "kind": node}
                self.tell(Event.CONFIGURED, values, node, stamp_ns=-1)
                if node == "disturbance":
                    self.tell(Event.ACTIVATED, {}, node, stamp_ns=-1)

    def write(self, states: States) -> None:
        """Write some states, and count what the controllers answered."""
        super().write(states)
        for name, rows in states.answers():
            self._commands[name] += rows.stop - rows.start
            self._updates[name] += int(states.table[rows, FRESH].sum())

    def put_changes_to_come(self) -> None:
        """Write the changes that no state has seen; in a graph nothing changes after the end."""
        if self._graph:
            self._changes = [entry for entry in self._changes if entry[1].stamp_ns <= self._last_ns]
        super().put_changes_to_come()

    def finished(self, reason: str) -> None:
        """Write the event that ends a whole run; nodes of a graph tell how much they have published."""
        super().finished(reason)
        if self._graph:
            self._published()

    def _published(self) -> None:
        plan, topic, states = self._plan, self._run.recording.topic, self.states
        of_states = [topics.GROUND_TRUTH, topics.JOINT_STATES]
        of_states += [topics.PLANT_INPUTS] if self._run.real_time else []
        counts = {"simulator": dict.fromkeys(of_states, states)}
        if pushes := sum(at_ns <= self._last_ns for at_ns, _ in plan.pushes):
            counts["simulator"][topics.OPERATOR_PUSH] = pushes
        if plan.disturbance is not None:
            since = states + 1 - self._resumed.first
            sent = self._sent(topics.DISTURBANCE, "disturbance")
            counts["disturbance"] = {topics.DISTURBANCE: sent + since}
        for name in plan.controllers:
            terms = topics.controller_state(name)
            counts[name] = {
                topics.EFFORT_COMMAND: self._commands[name],
                terms: self._updates[name],
            }
        for node, topic_counts in counts.items():
            if node not in self._silent:
                ahead = plan.simulator.period_ns if node == "disturbance" else 0
                values = {topic(name): str(count) for name, count in topic_counts.items()}
                self.tell(Event.PUBLISHED, values, node, stamp_ns=self._last_ns + ahead)
