"""A recording for the page: all of it at once, and nothing to ask for."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from trunk_control.rule_base import RuleBaseConfig
from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.units import NANOSECONDS

from ..recorded.run import RecordedRun
from .feed import (
    PLANT,
    PUSHES,
    Board,
    RefusedRequestError,
    Stream,
    StreamRows,
    columns_of,
    put_stream,
    with_rules,
)
from .graph import Graph
from .protocol import plain

if TYPE_CHECKING:
    from pathlib import Path

    from trunk_msgs_util.parameters.declarations import Value
    from trunk_msgs_util.recording.joint_table import Floats, JointTable

    from .protocol import Asked

_EVENTS = 10_000  # a hostile file may hold any number


class RecordedFeed:
    """A recorded run. What happened to its parameters later is among its events."""

    def __init__(self, path: Path) -> None:
        """Read it. Raises RecordingError."""
        self.board = Board()
        self.streams: list[Stream] = []
        run = RecordedRun.open(path)
        recording = run.recording
        self._graph = Graph(self.board, kept=_EVENTS)
        for node, values in run.parameters.items():
            self._graph.parameters(node, values)
        for event in run.events:
            name = recording.relative(event.node)
            self._graph.event(name, event.stamp_ns, event.message, event.values)
        self._put_changes(run)
        self._graph.put_events()
        self._add(PLANT, _plant(run.joints(topics.GROUND_TRUTH).by_stamp()))
        if run.count(topics.OPERATOR_PUSH):
            pushes = run.joints(topics.OPERATOR_PUSH).by_stamp()
            self._add(PUSHES, np.column_stack([_seconds(pushes), pushes.effort]))
        for name in run.controllers:
            self._add_controller(run, name)
        t = self.streams[0].rows
        self.board.put(
            "recorded",
            file=path.name,
            path=str(path),
            complete=recording.complete,
            end=recording.end,
            doubts=recording.further_warnings,
            first=float(t.since(0, 1)[1][0, 0]),
            last=t.last()["t"],
        )

    async def begin(self) -> None:
        """Do nothing."""

    def turn(self) -> None:
        """Take nothing: it is all there."""

    async def ask(self, client: str, asked: Asked) -> str:
        """Refuse whatever it is. Raises RefusedRequestError."""
        raise RefusedRequestError(
            "this is a recording: trunk branch tries out what would have happened with a change"
        )

    def close(self) -> None:
        """Nothing was opened."""

    def _put_changes(self, run: RecordedRun) -> None:
        """Put what was changed while the run went on, by time: the page starts with the first values."""
        values: dict[str, dict[str, Value]] = {}
        changes = []
        for change in run.recording.parameter_messages()[:_EVENTS]:
            node = run.recording.relative(change.node)
            known = values.setdefault(node, {})
            if change.changed:
                self._graph.events.change(node, change.stamp_ns, known, change.changed)
                new = {name: plain(value) for name, value in change.changed.items()}
                t = max(change.stamp_ns / NANOSECONDS, 0.0)
                changes.append({"t": t, "node": node, "values": new})
            known |= change.new | change.changed
        changes.sort(key=itemgetter("t"))
        self.board.put("changes", changes=changes)

    def _add(self, name: str, values: Floats) -> None:
        put_stream(
            self.board, self.streams, name, StreamRows.of(columns_of(name, (), None), values)
        )

    def _add_controller(self, run: RecordedRun, name: str) -> None:
        states = run.joints(topics.controller_state(name)).by_stamp()
        if not len(states) or states.position.shape[1] != len(states.names):
            return
        values = np.column_stack([_seconds(states), states.position])
        try:
            timeline = run.timeline(name)
        except (KeyError, ParameterError):
            columns = columns_of(name, states.names, None)
        else:
            columns = columns_of(name, states.names, timeline.config)
            rows = []
            for stamp_ns, row in zip(states.stamp_ns.tolist(), values.tolist(), strict=True):
                timeline.advance(stamp_ns)
                if isinstance(timeline.config, RuleBaseConfig):
                    rows.append(with_rules(tuple(row), states.names, timeline.config))
            values = np.array(rows) if rows else values
        put_stream(self.board, self.streams, name, StreamRows.of(columns, values))


def _seconds(arrays: JointTable) -> Floats:
    return arrays.stamp_ns / NANOSECONDS


def _plant(truth: JointTable) -> Floats:
    return np.column_stack([_seconds(truth), truth.position, truth.velocity, truth.effort[:, 1]])
