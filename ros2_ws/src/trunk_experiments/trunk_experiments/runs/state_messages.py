"""The messages that come with each state of an offline run, packed in bulk, each in its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.recording.joint_state_cdr import JointStateLayout, shared
from trunk_msgs_util.recording.writing.interleaved import Rows
from trunk_msgs_util.units import nanoseconds
from trunk_sim.disturbances import Disturbance

from ..plans.plan import RunPlan
from ..recorded.inputs import NAMES, NO_SOURCE
from .states import (
    ACTING,
    APPLIED,
    EFFORT,
    FRESH,
    OFFSET,
    POSITION,
    SEEN_APPLIED,
    SEEN_POSITION,
    SEEN_VELOCITY,
    TERMS,
    VELOCITY,
    States,
)

# The places of messages among those of a state, in the graph's order.
TURNED, _TRUTH, _FIRST_DISTURBANCE, _DISTURBANCE, _MEASURED = range(5)
_COMMAND, _TERMS, FELL, _INPUTS, PICTURE = range(5, 10)
PLACES = 10


class StateMessages:
    """Packs the joint states, commands, terms and disturbances of a plan's run."""

    def __init__(
        self,
        plan: RunPlan,
        channels: Mapping[str, int],
        acting: Callable[[int], Disturbance],
        first: int = 0,
        source: Callable[[str], str] = lambda _node: "",
        held: tuple[float, int, str] = (0.0, -1, ""),
    ) -> None:
        """``acting`` gives the disturbance at increasing stamps, ns; ``first`` is the first state's index.

        ``source``: of a node's messages. ``held``: the last command before the first state, N m, its stamp
        and its controller, where what acts is recorded.
        """
        self._plan, self._channels, self._acting = plan, channels, acting
        self._first, self._source, self._held = first, source, held
        self._efforts: Floats = np.empty(0)  # all commands, where earlier ones may act

    def stamps(self, first: int, count: int) -> Integers:
        return np.arange(first, first + count) * self._plan.simulator.period_ns

    def of(self, states: States, stamp_ns: Integers) -> list[Rows]:
        """Return the messages that come with each state."""
        table, joints = states.table, self._plan.simulator.joints
        every = np.arange(len(table))
        layout = JointStateLayout(joints, 2, 2, 2, self._source("simulator"))
        effort, measured_torque = np.zeros((2, len(table), 2))
        effort[:, 1], measured_torque[:, 1] = table[:, APPLIED], table[:, SEEN_APPLIED]
        rows_of_all = [
            self._joints(
                topics.GROUND_TRUTH,
                every * PLACES + _TRUTH,
                layout,
                stamp_ns,
                position=table[:, POSITION],
                velocity=table[:, VELOCITY],
                effort=effort,
            ),
            self._joints(
                topics.JOINT_STATES,
                every * PLACES + _MEASURED,
                layout,
                stamp_ns,
                position=table[:, SEEN_POSITION],
                velocity=table[:, SEEN_VELOCITY],
                effort=measured_torque,
            ),
        ]
        if self._plan.disturbance is not None:
            rows_of_all.append(self._disturbances(states))
        for name, rows in states.answers():
            names = states.term_names.get(name, ())
            rows_of_all += self._answers(name, names, table[rows], stamp_ns[rows], every[rows])
        if topics.PLANT_INPUTS in self._channels:
            rows_of_all += self._inputs(states, stamp_ns)
        return rows_of_all

    def _inputs(self, states: States, stamp_ns: Integers) -> Iterator[Rows]:
        """Yield the inputs that act in each state, as the simulator records them in real time."""
        table, count, plan = states.table, len(stamp_ns), self._plan
        values: Floats = np.zeros((count, 5))
        age: Floats = np.full((count, 5), -1.0)
        sources: Any = np.full(count, NO_SOURCE, object)
        if (inputs := plan.inputs) is not None:
            here = slice(states.first, states.first + count)
            self._efforts = np.append(self._efforts, table[:, EFFORT])
            index = inputs.command_index[here]
            acts, at = index >= 0, index * plan.simulator.period_ns
            values[acts, 0] = self._efforts[index[acts]]
            since = inputs.disturbance_ns[here]
            disturbed = since >= 0
        else:
            effort, at_ns, name = self._held
            held_source = self._source(name) or NO_SOURCE
            answered = np.zeros(count, bool)
            for name, span in states.answers():
                answered[span], sources[span] = True, self._source(name) or NO_SOURCE
            last = np.maximum.accumulate(np.where(answered, np.arange(count), -1))
            known = last >= 0
            at = np.where(known, stamp_ns[last], at_ns)
            values[:, 0] = np.where(known, table[last, EFFORT], effort)
            sources = np.where(known, sources[last], held_source)
            acts = (at >= 0) & (stamp_ns - at <= nanoseconds(plan.simulator.command_timeout))
            self._held = float(values[-1, 0]), int(at[-1]), name
            values[~acts, 0], sources[~acts] = 0.0, NO_SOURCE
            since = stamp_ns
            disturbed = np.full(count, plan.disturbance is not None)
        age[acts, 0] = (stamp_ns - at)[acts]
        values[:, 1:3], values[:, 3:] = table[:, ACTING], table[:, OFFSET]
        age[disturbed, 1:] = (stamp_ns - since)[disturbed, None]
        other = self._source("disturbance") or NO_SOURCE
        for source in dict.fromkeys(sources.tolist()):
            for there, name in ((True, other), (False, NO_SOURCE)):
                rows = np.flatnonzero((sources == source) & (disturbed == there))
                frame = " ".join((self._source("simulator") or NO_SOURCE, source, name))
                if len(rows):
                    yield self._joints(
                        topics.PLANT_INPUTS,
                        rows * PLACES + _INPUTS,
                        JointStateLayout(NAMES, 5, 5, 0, frame),
                        stamp_ns[rows],
                        position=values[rows],
                        velocity=age[rows],
                    )

    def _disturbances(self, states: States) -> Rows:
        """Return the disturbances: like the node, one step ahead of the state, and both for the first."""
        count = len(states.table)
        stamp_ns = self.stamps(states.first, count + 1)
        place = np.arange(-1, count) * PLACES + _DISTURBANCE
        place[0] = _FIRST_DISTURBANCE
        wanted = np.ones(count + 1, bool)
        wanted[0] = states.first == self._first
        if (inputs := self._plan.inputs) is None:
            ahead = self._acting(int(stamp_ns[-1]))
            effort, offset = (
                np.vstack([states.table[:, columns], [values]])
                for columns, values in ((ACTING, ahead[:2]), (OFFSET, ahead[2:]))
            )
        else:  # what acts may be an earlier message
            own = np.zeros((count + 1, 4))
            for row in np.flatnonzero(wanted).tolist():
                own[row] = self._acting(int(stamp_ns[row]))
            effort, offset = own[:, :2], own[:, 2:]
            wanted &= np.isin(stamp_ns, inputs.disturbed)
        return self._joints(
            topics.DISTURBANCE,
            place[wanted],
            JointStateLayout(self._plan.simulator.joints, 2, 0, 2, self._source("disturbance")),
            stamp_ns[wanted],
            position=offset[wanted],
            effort=effort[wanted],
        )

    def _answers(
        self,
        name: str,
        names: tuple[str, ...],
        table: Floats,
        stamp_ns: Integers,
        rows: Integers,
    ) -> Iterator[Rows]:
        """Yield a controller's commands, and its terms, of these names, where they are fresh."""
        yield self._joints(
            topics.EFFORT_COMMAND,
            rows * PLACES + _COMMAND,
            JointStateLayout((self._plan.simulator.joints[1],), 0, 0, 1, self._source(name)),
            stamp_ns,
            effort=table[:, EFFORT, None],
        )
        fresh = table[:, FRESH] == 1.0
        yield self._joints(
            topics.controller_state(name),
            rows[fresh] * PLACES + _TERMS,
            JointStateLayout(names, len(names), frame_id=self._source(name)),
            stamp_ns[fresh],
            position=table[fresh, TERMS : TERMS + len(names)],
        )

    def _joints(
        self,
        topic: str,
        place: Integers,
        layout: JointStateLayout,
        stamp_ns: Integers,
        **quantities: Floats,
    ) -> Rows:
        data = shared(layout).pack_rows(stamp_ns, **quantities)
        return Rows(self._channels[topic], place, stamp_ns, data)
