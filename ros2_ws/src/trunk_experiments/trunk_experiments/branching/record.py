"""Records a branch: its past as the parent has it, then what its nodes do from there on."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from trunk_msgs_util import provenance, topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.process_id import process_id
from trunk_msgs_util.real_path import real_path
from trunk_msgs_util.recording.writer import PROVENANCE, RecordingWriter
from trunk_msgs_util.whole_file import whole_file
from trunk_sim.simulation import DivergedError

from ..plans.plan import RunPlan
from ..recorded.branch_of import AT, CHANGES, MADE_BY, OF, PARENT
from ..recorded.run import RecordedRun
from ..replay.as_told import PUBLISHES
from ..runs.loop import states_of
from ..runs.offline import steps_from
from ..runs.offline_recording import OfflineRecorder, Within
from ..runs.states import FRESH, States, in_stretches, longest
from .branch import Branch
from .change import Branched
from .past import Past

Progress = Callable[[int, int], None]


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
    plan, first = resumed.plan, resumed.first
    duration = {"duration": plan.simulator.duration}
    planned = run.config("simulator").duration
    replaced = {"simulator": duration} if planned not in (0.0, plan.simulator.duration) else {}
    past = Past(run, resumed.stamp_ns, replaced)
    diverged = None
    with whole_file(path, overwrite=overwrite) as part, RecordingWriter(part) as writer:
        writer.add_metadata(PROVENANCE, _origin(run, branch, plan))
        past.copy(writer)
        within = Within(first, past.ahead_ns, run.recording.topic)
        recorder = OfflineRecorder(plan, tuple(plan.controllers), writer, within)
        words = _Words(run, branched, recorder)
        words.introduce()
        taken = steps_from(plan, resumed.begun)
        try:
            for some in in_stretches(taken, longest(plan.simulator.substeps), first):
                recorder.write(some)
                words.count(some)
                progress(recorder.states - first, states_of(plan) - first)
        except DivergedError as error:
            diverged = error
            words.to_come()
            recorder.failed(str(error))
            writer.finish(complete=False, reason=str(error))
        else:
            fell = len(some.table) - 1 in some.falls and plan.simulator.fall_stop
            reason = "the trunk has fallen" if fell else "finished"
            if not planned and not replaced:
                reason = "stopped on request"
            words.to_come()
            recorder.finished(reason)
            words.published()
            writer.finish(complete=True, reason=reason)
    if diverged is not None:
        raise diverged
    return recorder.states


def digest_of(files: Iterable[Path]) -> str:
    """Return the SHA-256 of some files, one after the other, in hexadecimal digits."""
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while some := file.read(1 << 20):
                digest.update(some)
    return digest.hexdigest()


def _origin(run: RecordedRun, branch: Branch, plan: RunPlan) -> dict[str, str]:
    """Return the parent's origin, and whose branch this is."""
    here = provenance.gather()
    told = {
        OF: digest_of(run.recording.files),
        PARENT: real_path(run.path).name,
        AT: repr(branch.at),
        CHANGES: branch.describe(),
        MADE_BY: f"trunk_experiments {here['trunk_experiments']}, commit {here['commit']}",
    }
    if run.mode == "offline":
        told["controller"] = " ".join(plan.controllers)
    return {**run.recording.provenance, "mcap": here["mcap"], **told}


class _Words:
    """What the nodes of a branch say besides the run itself: a graph's nodes say more than offline ones."""

    def __init__(self, run: RecordedRun, branched: Branched, recorder: OfflineRecorder) -> None:
        self._run, self._resumed, self._recorder = run, branched.resumed, recorder
        self._new = branched.new
        self._graph = run.mode != "offline"
        self._commands = Counter(branched.resumed.commands)
        self._updates = Counter(
            {
                name: int((stamps < branched.resumed.stamp_ns).sum())
                for name in run.controllers
                for stamps in (run.table(topics.controller_state(name)).stamp_ns,)
            }
        )
        self._silent = {
            run.recording.relative(event.node)
            for event in run.events
            if event.message in (Event.PUBLISHED, Event.CLEANED_UP)
            and event.stamp_ns < branched.resumed.stamp_ns
        }

    def introduce(self) -> None:
        """Tell of nodes that the parent does not have: their parameters; in a graph, that they are there."""
        for node, config in self._new.items():
            self._recorder.put_parameters(node, config)
            if self._graph:
                values = {"process": process_id(), "kind": node}
                self._recorder.tell(Event.CONFIGURED, values, node, stamp_ns=-1)
                if node == "disturbance":
                    self._recorder.tell(Event.ACTIVATED, {}, node, stamp_ns=-1)

    def count(self, states: States) -> None:
        """Count what the controllers answered."""
        ends = [row for row, _ in states.acts[1:]] + [len(states.table)]
        for (begin, name), end in zip(states.acts, ends, strict=True):
            if name:
                self._commands[name] += end - begin
                self._updates[name] += int(states.table[begin:end, FRESH].sum())

    def to_come(self) -> None:
        """Tell what changed after the last state was answered; nothing changes in a graph after its end."""
        last_ns = (self._recorder.states - 1) * self._resumed.plan.simulator.period_ns
        self._recorder.put_changes_to_come(last_ns if self._graph else None)

    def published(self) -> None:
        """Tell how much each node of a graph has published, as it does when it ends."""
        if not self._graph:
            return
        plan, topic = self._resumed.plan, self._run.recording.topic
        states = self._recorder.states
        counts = {"simulator": dict.fromkeys(PUBLISHES["simulator"], states)}
        if plan.disturbance is not None:
            told_ns = self._run.table(topics.DISTURBANCE).stamp_ns
            before = int((told_ns < self._resumed.stamp_ns).sum())
            since = states + 1 - self._resumed.first
            counts["disturbance"] = {topics.DISTURBANCE: before + since}
        for name in plan.controllers:
            told, effort = PUBLISHES[name]
            counts[name] = {effort: self._commands[name], told: self._updates[name]}
        last_ns = (states - 1) * plan.simulator.period_ns
        for node, some in counts.items():
            if node not in self._silent:
                ahead = plan.simulator.period_ns if node == "disturbance" else 0
                values = {topic(name): str(count) for name, count in some.items()}
                self._recorder.tell(Event.PUBLISHED, values, node, stamp_ns=last_ns + ahead)
