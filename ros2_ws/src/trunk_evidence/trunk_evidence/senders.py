"""The process of each of a run's nodes: how it was configured, what changed in it, what it published.

In real time every message names the process that sent it, and of several the first that acted is the node's;
its part ends where another one acts. In simulated time there is one process a node.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Integers
from trunk_core.parameters.declarations import Value, build
from trunk_core.topics import Event, as_count
from trunk_msgs_util.source import sources_of_inputs
from trunk_recording.reader import RecordingError
from trunk_recording.schemas import ParameterChange, RunEvent
from trunk_runs.nodes import CONTROLLERS, config_class
from trunk_runs.timeline import Change

if TYPE_CHECKING:
    from trunk_recording.joint_table import JointTable

    from .recorded_run import RecordedRun

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
    until_ns: int | None = None  # the state in which another process of its name first acted

    @cached_property
    def config(self) -> Any:
        """The configuration at the start. Raises ParameterError, KeyError for a node that is not ours."""
        return build(config_class(self.node, self.parameters), self.parameters)

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
        sources = (frame.partition(" ")[0] for frame in table.frames)
        return [place for place, source in enumerate(sources) if source == self.source]

    def sent_all(self, table: JointTable) -> bool:
        """Return True if every message of a topic is this process's."""
        everything = not self.source or len(self._frames(table)) == len(table.frames)
        return everything and self.until_ns is None

    def rows(self, table: JointTable) -> Integers:
        """Return the rows of a topic that this process sent as its node, in the order of the file."""
        if not self.source:
            return np.arange(len(table))
        mine = np.isin(table.frame, self._frames(table))
        if self.until_ns is not None:
            mine &= table.stamp_ns < self.until_ns
        return np.flatnonzero(mine)

    def stamps(self, table: JointTable) -> Integers:
        """Return the stamps of the messages of a topic that this process sent, ns, in file order."""
        return table.stamp_ns if self.sent_all(table) else table.stamp_ns[self.rows(table)]

    @property
    def published(self) -> Mapping[str, int]:
        """How many messages it said it had published when it ended, by topic; empty: it did not say."""
        counts = (e.values for e in self.events if e.message == Event.PUBLISHED)
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
    name = run.topic(node)
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
    for change in run.parameter_messages:
        if change.node != name:
            continue
        process = change.source.rpartition("@")[2]
        if change.new:
            current = process or next(unnamed, current)
            sets.setdefault(current, change.new)
        else:
            changed.setdefault(process or current, []).append(change)
    own = name.rpartition("/")[2]
    return [
        Process(
            node,
            f"{own}@{process}",
            str(run.path),
            sets.get(process, {}),
            events.get(process, ()),
            changed.get(process, ()),
        )
        for process in dict.fromkeys([*events, *sets])
    ]


def acted(run: RecordedRun, node: str) -> Process | None:
    """Return the process that is the node's: the first of its own that acted, up to where another one did.

    Of a node of which none acted it is the first, and of simulators the first that started. None: no process
    is on record.
    """
    processes = run.processes(node)
    if len(processes) < 2:
        return next(iter(processes), None)
    if node == "simulator":
        started = [p for p in processes if any(e.message == Event.STARTED for e in p.events)]
        return (started or processes)[0]
    by_source = {process.source: process for process in processes}
    first, *others = [s for s in run.sources_in_force if s in by_source] or [processes[0].source]
    until_ns = run.sources_in_force[others[0]] if others else None
    return replace(by_source[first], until_ns=until_ns)


def sources_in_force(run: RecordedRun, kinds: Sequence[int] = (0, 1)) -> dict[str, int]:
    """Return in which state each source first acted on the plant of a real-time run, ns, in that order.

    ``kinds``: 0 for commands, 1 for disturbances. Another robot does not say what acts: its commands count.
    Raises RecordingError for messages that cannot be read.
    """
    if not run.count(topics.PLANT_INPUTS):
        # As recorded: what a node took depends on who acts, which is asked here.
        commands = run.recording.joints(run.topic(topics.EFFORT_COMMAND))
        which, at = np.unique(commands.frame, return_index=True)
        firsts = zip(commands.stamp_ns[at].tolist(), which.tolist(), strict=True)
        return {commands.frames[place]: stamp_ns for stamp_ns, place in sorted(firsts)}
    table = run.table(topics.PLANT_INPUTS)
    simulator = run.process("simulator")
    if simulator is None or table.names != topics.INPUT_NAMES or not table.width("velocity"):
        return {}
    rows = simulator.rows(table)
    ages, frame = table.values("velocity")[rows], table.frame[rows]
    first: dict[str, int] = {}
    for place, text in enumerate(table.frames):
        _, *sources = sources_of_inputs(text) or ("", "", "")
        for source, column in ((sources[kind], kind) for kind in kinds):
            held = (frame == place) & (ages[:, column] >= 0.0)
            if held.any():
                row = int(np.argmax(held))
                first[source] = min(row, first.get(source, row))
    stamps = table.stamp_ns[rows]
    return {source: int(stamps[row]) for source, row in sorted(first.items(), key=itemgetter(1))}


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
    parameters = run.first_sets.get(name, {})
    return Process(node, "", str(run.path), parameters, mine, run.parameter_changes(node))


def is_whole(run: RecordedRun, process: Process) -> bool:
    """Return True if all that a process sent is on record, so that it can be held to it."""
    if run.mode == "offline":
        return True
    complete, counts = (run.recording.end or {}).get("complete") == "true", process.published
    if run.exact:
        return complete or bool(counts)
    return bool(counts) and (complete or all(map(partial(_has_all, run, process), counts.items())))


def _has_all(run: RecordedRun, process: Process, counted: tuple[str, int]) -> bool:
    """Return True if so many messages of a process are on record, of this run alone."""
    topic, count = counted
    if topic not in run.recording.topics:
        return False
    stamps = process.stamps(run.table(run.relative(topic)))
    return len(stamps) == count and not (np.diff(stamps) < 0).any()
