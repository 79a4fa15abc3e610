"""The messages that come with each state of an offline run, packed in bulk, each in its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.recording.joint_state_cdr import JointStateLayout, shared
from trunk_msgs_util.recording.joint_state_rows import packed
from trunk_msgs_util.recording.writing.interleaved import Rows
from trunk_sim.disturbances import Disturbance

from ..plans.plan import RunPlan
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
_COMMAND, _TERMS, FELL, PICTURE = range(5, 9)
PLACES = 9


class StateMessages:
    """Packs the joint states, commands, terms and disturbances of a plan's run."""

    def __init__(
        self,
        plan: RunPlan,
        channels: Mapping[str, int],
        acting: Callable[[int], Disturbance],
        first: int = 0,
    ) -> None:
        """``acting`` gives the disturbance at increasing stamps, ns; ``first`` is the first state's index."""
        self._plan, self._channels, self._acting = plan, channels, acting
        self._first = first

    def stamps(self, first: int, count: int) -> Integers:
        return np.arange(first, first + count) * self._plan.simulator.period_ns

    def of(self, states: States, stamp_ns: Integers) -> list[Rows]:
        """Return the messages that come with each state."""
        table, joints = states.table, self._plan.simulator.joints
        every = np.arange(len(table))
        layout = JointStateLayout(joints, 2, 2, 2)
        effort, felt = np.zeros((2, len(table), 2))
        effort[:, 1], felt[:, 1] = table[:, APPLIED], table[:, SEEN_APPLIED]
        found = [
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
                effort=felt,
            ),
        ]
        if self._plan.disturbance is not None:
            found.append(self._disturbances(states))
        for name, rows in states.answers():
            names = states.told.get(name, ())
            found += self._answers(name, names, table[rows], stamp_ns[rows], every[rows])
        return found

    def _disturbances(self, states: States) -> Rows:
        """Return the disturbances: like the node, one step ahead of the state, and both for the first."""
        count = len(states.table)
        stamp_ns = self.stamps(states.first, count + 1)
        place = np.arange(-1, count) * PLACES + _DISTURBANCE
        place[0] = _FIRST_DISTURBANCE
        ahead = self._acting(int(stamp_ns[-1]))
        effort, offset = (
            np.vstack([states.table[:, columns], [values]])
            for columns, values in ((ACTING, ahead[:2]), (OFFSET, ahead[2:]))
        )
        new = slice(0 if states.first == self._first else 1, None)
        return self._joints(
            topics.DISTURBANCE,
            place[new],
            JointStateLayout(self._plan.simulator.joints, 2, 0, 2),
            stamp_ns[new],
            position=offset[new],
            effort=effort[new],
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
            JointStateLayout((self._plan.simulator.joints[1],), 0, 0, 1),  # `check_joints`
            stamp_ns,
            effort=table[:, EFFORT, None],
        )
        fresh = table[:, FRESH] == 1.0
        yield self._joints(
            topics.controller_state(name),
            rows[fresh] * PLACES + _TERMS,
            JointStateLayout(names, len(names)),
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
        data = packed(shared(layout), stamp_ns, **quantities)
        return Rows(self._channels[topic], place, stamp_ns, data)
