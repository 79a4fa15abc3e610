"""`RecordedRun`: a recording, loaded once for all that judge, explain or repeat the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import Value, build
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.recording.schemas import ParameterChange, RunEvent
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS, NODES
from ..plans.plan import RunPlan
from ..plans.timeline import Change, Timeline

EXACT_MODES = (
    "lockstep",
    "offline",
)  # time is exact: every state is answered, and can be recomputed


class JointTable:
    """A JointState topic whose rows are found by stamp; of equal stamps the first row counts."""

    def __init__(self, recording: Recording, relative: str) -> None:
        self.topic = relative
        self._where = f"{recording.path}: {recording.topic(relative)}"
        arrays = recording.joints(recording.topic(relative))
        self.names = arrays.names
        self.stamp_ns: Integers = arrays.stamp_ns
        self.log_time_ns: Integers = arrays.log_time_ns
        self._values: dict[str, Floats] = {
            quantity: getattr(arrays, quantity) for quantity in ("position", "velocity", "effort")
        }

    @cached_property
    def stamps(self) -> list[int]:
        """All stamps in file order, ns."""
        return [int(stamp) for stamp in self.stamp_ns.tolist()]

    @cached_property
    def rows(self) -> Mapping[int, int]:
        """Each stamp's row."""
        rows: dict[int, int] = {}
        for row, stamp in enumerate(self.stamps):
            rows.setdefault(stamp, row)
        return rows

    def __contains__(self, stamp_ns: int) -> bool:
        return stamp_ns in self.rows

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def get(self, stamp_ns: int, quantity: str, count: int | None = None) -> list[float]:
        """Return a message's values of a quantity, one for each name; KeyError without the stamp.

        Raises RecordingError if they are not as many as the names, or as ``count``.
        """
        values: list[float] = self._values[quantity][self.rows[stamp_ns]].tolist()
        needed = len(self.names) if count is None else count
        if not len(values) == len(self.names) == needed:
            raise RecordingError(
                f"{self._where}: {len(values)} values of {quantity} for {len(self.names)} names at "
                f"t = {seconds(stamp_ns):g} s, {needed} are needed: it cannot be recomputed"
            )
        return values

    def index(self, joint: str) -> int:
        """Return the index of a joint's values. Raises RecordingError if there is none."""
        if joint not in self.names:
            there = f"only {', '.join(self.names)}" if len(self) else "and no messages"
            raise RecordingError(
                f"{self._where} has no joint {joint!r}, {there}: it cannot be recomputed"
            )
        return self.names.index(joint)

    def values(self, quantity: str) -> Floats:
        """Return all values of a quantity [N, names], or [N, 0] if no message carries it."""
        return self._values[quantity]

    def rows_of(self, stamps: Integers) -> Integers:
        """Return the row of each stamp, -1 if there is none."""
        order = np.argsort(self.stamp_ns, kind="stable")
        known = self.stamp_ns[order]
        if not len(known):
            return np.full(len(stamps), -1)
        at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
        return np.where(known[at] == stamps, order[at], -1)


class RecordedRun:
    """What a recording says about its run. Each part is read on first use and kept.

    Reading a part raises RecordingError for messages that cannot be read.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self._tables: dict[str, JointTable] = {}
        self._configs: dict[str, Any] = {}

    @classmethod
    def open(cls, path: str | Path) -> RecordedRun:
        """Open a recording. Raises RecordingError."""
        return cls(Recording.open(path))

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

    @cached_property
    def controllers(self) -> Sequence[str]:
        """All nodes whose ``~/state`` was recorded, in the plan's order."""
        return tuple(self.recording.controllers)

    @cached_property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters at the start, by its name without the run's namespace."""
        prefix = self.recording.topic("")
        return {
            name.removeprefix(prefix): values
            for name, values in self.recording.parameters().items()
        }

    @cached_property
    def events(self) -> Sequence[RunEvent]:
        """The run's events in file order."""
        return tuple(self.recording.events())

    @cached_property
    def _parameter_changes(self) -> Sequence[ParameterChange]:
        return tuple(self.recording.parameter_changes())

    def count(self, relative: str) -> int:
        """Return how many messages of a topic there are."""
        topic = self.recording.topics.get(self.recording.topic(relative))
        return topic.count if topic else 0

    def table(self, relative: str) -> JointTable:
        """Return a JointState topic's table."""
        if relative not in self._tables:
            self._tables[relative] = JointTable(self.recording, relative)
        return self._tables[relative]

    def config(self, node: str) -> Any:
        """Return a node's configuration at the start.

        Raises KeyError if it was not recorded, ParameterError if it cannot be used.
        """
        if node not in self._configs:
            self._configs[node] = build(NODES[node].config, self.parameters[node])
        return self._configs[node]

    def changes(self, node: str) -> list[Change]:
        """Return a node's changes of parameters and resets, and a controller's turns, in their order.

        Raises RecordingError if the record does not tell the order: it holds other events
        of changed parameters than changes.
        """
        name = self.recording.topic(node)
        changed = [change for change in self._parameter_changes if change.node == name]
        # The plant's turns are pauses, in which simulated time stands still.
        wanted = (Event.RETUNED, Event.RESET) + (
            (Event.ACTIVATED, Event.DEACTIVATED) if node in CONTROLLERS else ()
        )
        events = [event for event in self.events if event.node == name and event.message in wanted]
        retuned = [event for event in events if event.message == Event.RETUNED]
        if [e.stamp_ns for e in retuned] != [change.stamp_ns for change in changed]:
            raise RecordingError(
                f"{self.path}: {node}: {len(changed)} changes of parameters, but {len(retuned)} events "
                "that place them, or at other times: their order is not known"
            )
        values = iter(changed)
        found = [
            Change(event.stamp_ns, next(values).changed)
            if event.message == Event.RETUNED
            else Change(event.stamp_ns, None, event.message)
            for event in events
        ]
        # A controller that joins a run under way reports it once more: it is active from there on.
        turns = [change for change in found if change.event in (Event.ACTIVATED, Event.DEACTIVATED)]
        again = [
            one
            for one, after in pairwise(turns)
            if one.event == after.event == Event.ACTIVATED and one.stamp_ns < after.stamp_ns
        ]
        return [change for change in found if not any(change is one for one in again)]

    def timeline(self, node: str) -> Timeline:
        """Return a node's configuration at the start and its changes during the run."""
        return Timeline(self.config(node), self.changes(node))

    def plan(self) -> RunPlan:
        """Return the plan of the recorded run, as many steps as were recorded, and what happened in it.

        Raises RecordingError if the recording lacks something that this needs.
        """
        controllers = self.controllers
        if not controllers or not set(controllers) <= set(CONTROLLERS):
            raise RecordingError(
                f"{self.path}: no controller of {', '.join(CONTROLLERS)} was recorded: "
                "it cannot be run again"
            )
        states = self.count(topics.GROUND_TRUTH)
        missing = {*controllers, "simulator"} - set(self.parameters)
        if missing or not states:
            what = f"parameters of {', '.join(sorted(missing))}" if missing else "true states"
            raise RecordingError(f"{self.path}: no {what} recorded: it cannot be run again")
        simulator = self.config("simulator")
        plan = RunPlan(
            scenario=self.recording.provenance.get("scenario", ""),
            simulator=replace(simulator, duration=seconds((states - 1) * simulator.period_ns)),
            controllers={name: self.config(name) for name in controllers},
            disturbance=self.config("disturbance") if "disturbance" in self.parameters else None,
            recorder=RecorderConfig(controllers=tuple(controllers)),
        )
        changes = {name: self.changes(name) for name in plan.configs}
        return replace(
            plan,
            changes={name: found for name, found in changes.items() if found},
            references=self._references(),
        )

    def _references(self) -> dict[int, float]:
        """Return the controllers' references that came by topic and are in no parameter."""
        found: dict[int, float] = {}
        for name in self.controllers:
            told = any(
                (change.values or {}).get("reference.profile") == "topic"
                for change in self.changes(name)
            )
            if told or self.config(name).reference_profile == "topic":
                terms = self.table(topics.controller_state(name))
                values = terms.values("position")
                if len(terms) and values.shape[1]:
                    found |= dict(zip(terms.stamps, values[:, 0].tolist(), strict=True))
        return found
