"""The processes of a run's nodes: how each was configured, what changed in it, how much it published.

In real time every message names the process that sent it. In simulated time there is one process a node.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event, as_count
from trunk_msgs_util.parameters.declarations import Value, build
from trunk_msgs_util.recording.joint_table import Integers
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.recording.schemas import ParameterChange, RunEvent
from trunk_msgs_util.source import sources_of_inputs

from ..plans.nodes import CONTROLLERS, NODES
from ..plans.timeline import Change

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_table import JointTable

    from .run import RecordedRun

TURNS = (Event.ACTIVATED, Event.DEACTIVATED, Event.CLEANED_UP)


class UnorderedError(RecordingError):
    """The order of a process's changes is not known: some of them are not on record."""


@dataclass(frozen=True)
class Process:
    """One process of a node; ``source`` is empty in simulated time."""

    node: str
    source: str
    path: str  # of the recording, for messages
    parameters: Mapping[str, Value] = field(
        default_factory=dict
    )  # at its start; empty: not recorded
    events: Sequence[RunEvent] = ()
    changed: Sequence[ParameterChange] = ()
    until_ns: int | None = None  # by log time: what it sent later belongs to another run

    @cached_property
    def config(self) -> Any:
        """The configuration at the start. Raises ParameterError, KeyError for a node that is not ours."""
        return build(NODES[self.node].config, self.parameters)

    @cached_property
    def changes(self) -> list[Change]:
        """Changes of parameters and resets, and a controller's turns, in their order.

        Raises UnorderedError if the events of changed parameters do not match the changes.
        """
        # The plant's turns are pauses, in which simulated time stands still.
        turns = TURNS if self.node in CONTROLLERS else ()
        events = [e for e in self.events if e.message in (Event.RETUNED, Event.RESET, *turns)]
        retuned = [event.stamp_ns for event in events if event.message == Event.RETUNED]
        if retuned != [change.stamp_ns for change in self.changed]:
            raise UnorderedError(
                f"{self.path}: {self.node}: {len(self.changed)} changes of parameters, but {len(retuned)} "
                "events that place them, or at other times: their order is not known"
            )
        return list(_without_second_reports(_changes(events, self.changed), not self.source))

    def _frames(self, table: JointTable) -> list[int]:
        """Return which frames of a topic are this process's; that of an input begins with its source."""
        inputs = table.topic == topics.PLANT_INPUTS
        frames = [frame.partition(" ")[0] if inputs else frame for frame in table.frames]
        return [place for place, source in enumerate(frames) if source == self.source]

    def sent_all(self, table: JointTable) -> bool:
        """Return True if every message of a topic is this process's."""
        everything = not self.source or len(self._frames(table)) == len(table.frames)
        return everything and self.until_ns is None

    def rows(self, table: JointTable, in_run: bool = True) -> Integers:
        """Return the rows of a topic that this process sent, in the order of the file.

        ``in_run``: in the run that is judged. A later one begins, at the latest, where stamps go back.
        """
        rows = (
            np.flatnonzero(np.isin(table.frame, self._frames(table)))
            if self.source
            else np.arange(len(table))
        )
        if self.until_ns is None or not in_run:
            return rows
        later = table.log_time_ns[rows] >= self.until_ns
        later[1:] |= np.diff(table.stamp_ns[rows]) < 0
        return rows[: int(np.argmax(later))] if later.any() else rows

    def stamps(self, table: JointTable) -> Integers:
        """Return the stamps of the messages of a topic that this process sent, ns, in file order."""
        return table.stamp_ns if self.sent_all(table) else table.stamp_ns[self.rows(table)]

    @property
    def published(self) -> Mapping[str, int] | None:
        """How many messages it said it had published when it ended, by topic; None: it did not say."""
        counts = [e.values for e in self.events if e.message == Event.PUBLISHED]
        if not counts:
            return None
        return {topic: as_count(text) for values in counts for topic, text in values.items()}


def _changes(events: Iterable[RunEvent], changed: Sequence[ParameterChange]) -> Iterable[Change]:
    values = iter(changed)
    since_ns = -1  # a node that was cleaned up stamps -1 again until it sees a state
    for event in events:
        if event.message == Event.CLEANED_UP:
            since_ns = event.stamp_ns
        stamp_ns = max(event.stamp_ns, since_ns)
        if event.message == Event.RETUNED:
            yield Change(stamp_ns, next(values).changed)
        else:
            yield Change(stamp_ns, None, event.message)


def _without_second_reports(changes: Iterable[Change], alone: bool) -> Iterator[Change]:
    """Yield the changes; of two activations of a controller that joins a run under way, the second.

    ``alone``: it is the only process, so that states before it would be taken for states that it saw.
    """
    listed = list(changes)
    turns = [change for change in listed if change.event in (Event.ACTIVATED, Event.DEACTIVATED)]
    twice = [
        (first, after)
        for first, after in pairwise(turns)
        if first.event == after.event == Event.ACTIVATED and first.stamp_ns < after.stamp_ns
    ]
    for change in listed:
        if any(change is early for early, _ in twice):
            continue
        if alone and any(change is late for _, late in twice):
            yield Change(change.stamp_ns, None, Event.CLEANED_UP)
        yield change


def processes_of(run: RecordedRun, node: str) -> list[Process]:
    """Return the processes of a node, the first to be configured first.

    Events and parameter sets without a source belong to the process that was configured last before them, in
    the order of the file: a node that answers states does not know before the first whether time is real.
    """
    name = run.recording.topic(node)
    if not run.real_time:
        return [_only_process(run, node, name)]
    events: dict[str, list[RunEvent]] = {}
    current = ""
    for event in run.events:
        if event.node == name:
            if event.message == Event.CONFIGURED:
                current = event.values.get("process", "")
            process = event.source.rpartition("@")[2] or current
            events.setdefault(process, []).append(event)
    sets: dict[str, Mapping[str, Value]] = {}
    changed: dict[str, list[ParameterChange]] = {}
    unnamed = iter([process for process in events if process])
    current = ""
    for change in run.recording.parameter_messages():
        if change.node != name:
            continue
        process = change.source.rpartition("@")[2]
        if change.new:
            current = process or next(unnamed, current)
            sets.setdefault(current, change.new)
        else:
            changed.setdefault(process or current, []).append(change)
    own = name.rpartition("/")[2]
    until_ns = None if node == "simulator" else _second_run_ns(run)
    return [
        Process(
            node,
            f"{own}@{process}",
            str(run.path),
            sets.get(process, {}),
            events.get(process, ()),
            changed.get(process, ()),
            until_ns,
        )
        for process in dict.fromkeys([*events, *sets])
    ]


def acted(run: RecordedRun, node: str) -> Process | None:
    """Return the process whose parameters and changes are the node's: the first of its own that acted.

    Of a node of which none acted it is the first. None: no process is on record.
    """
    processes = run.processes(node)
    if len(processes) < 2:
        return next(iter(processes), None)
    if node == "simulator":
        return simulator_of(run)
    by_source = {process.source: process for process in processes}
    return next(filter(None, map(by_source.get, run.sources_in_force)), processes[0])


def sources_in_force(run: RecordedRun, kinds: Sequence[int] = (0, 1)) -> tuple[str, ...]:
    """Return the sources of what acted on the plant of a real-time run, the first to act first.

    ``kinds``: 0 for commands, 1 for disturbances. Raises RecordingError for messages that cannot be read.
    """
    table = run.table(topics.PLANT_INPUTS)
    if table.names != topics.INPUT_NAMES or not table.width("velocity"):
        return ()
    rows = simulator_of(run).rows(table)
    ages, frame = table.values("velocity")[rows], table.frame[rows]
    first: dict[str, int] = {}
    for place, text in enumerate(table.frames):
        _, *sources = sources_of_inputs(text) or ("", "", "")
        for source, column in ((sources[kind], kind) for kind in kinds):
            held = (frame == place) & (ages[:, column] >= 0.0)
            if held.any():
                row = int(np.argmax(held))
                first[source] = min(row, first.get(source, row))
    return tuple(sorted(first, key=first.__getitem__))


def simulator_of(run: RecordedRun) -> Process:
    """Return the process of the simulator whose run it is: the first that started."""
    processes = run.processes("simulator")
    started = [p for p in processes if any(e.message == Event.STARTED for e in p.events)]
    return (started or processes)[0]


def _second_run_ns(run: RecordedRun) -> int | None:
    """Return when the first true state of another run was logged, ns; None if all are of one simulator."""
    if len(run.processes("simulator")) < 2:
        return None
    truth = run.table(topics.GROUND_TRUTH)
    others = np.ones(len(truth), bool)
    others[simulator_of(run).rows(truth)] = False
    return int(truth.log_time_ns[others].min()) if others.any() else None


def _only_process(run: RecordedRun, node: str, name: str) -> Process:
    """Return the first process of a node in simulated time: a later one belongs to another run."""
    mine: list[RunEvent] = []
    current = ""
    for event in run.events:
        if event.node != name:
            continue
        if event.message == Event.CONFIGURED:
            process = event.values.get("process", "")
            if current not in ("", process):  # it belongs to another run
                break
            current = process
        mine.append(event)
    parameters = run.recording.parameters().get(name, {})
    return Process(node, "", str(run.path), parameters, mine, run.parameter_changes(node))


def is_whole(run: RecordedRun, process: Process) -> bool:
    """Return True if all that a process sent is on record, so that it can be held to it."""
    if run.mode == "offline":
        return True
    complete = (run.recording.end or {}).get("complete") == "true"
    counts = process.published
    if counts is None:
        return complete and run.exact
    if complete or not run.real_time:
        return True
    for topic, count in counts.items():
        if topic not in run.recording.topics:
            return False
        table = run.table(run.recording.relative(topic))
        earlier = (
            np.diff(process.stamps(table)) < 0
        ).any()  # messages of a run that is not on record
        if earlier or len(process.rows(table, in_run=False)) != count:
            return False
    return True
