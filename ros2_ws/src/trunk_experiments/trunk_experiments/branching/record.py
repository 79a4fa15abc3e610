"""Records a branch: its past as the parent has it, then what its nodes do from there on."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from trunk_msgs_util import provenance, topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.files import atomic_write, resolve_path
from trunk_msgs_util.recording.joint_arrays import Integers
from trunk_msgs_util.recording.writer import PROVENANCE, RecordingWriter
from trunk_msgs_util.source import process_id

from ..plans.plan import RunPlan
from ..recorded.run import AT, CHANGES, MADE_BY, OF, PARENT, RecordedRun
from ..runs.engine import Engine
from ..runs.offline_recording import OfflineRecorder, Progress, Within
from ..runs.states import FRESH, States
from .branch import Branch
from .change import Branched
from .past import Past


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
        if run.sourced:
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
        if not self._run.sourced:
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
        of_states += [topics.PLANT_INPUTS] if self._run.sourced else []
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
