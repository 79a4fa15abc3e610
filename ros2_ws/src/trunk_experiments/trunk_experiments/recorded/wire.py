"""A recorded run's links: which of its readings were seen, and which of its commands acted, in each step."""

from __future__ import annotations

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Integers
from trunk_sim.config import SimulatorConfig
from trunk_sim.traffic import Traffic

_FAR = 100_000  # steps beyond ten times the number of states: no run has more


class RecordedWire:
    """The messages in use, from the seed alone; without links, those of the step itself."""

    def __init__(self, config: SimulatorConfig, stamps: Integers) -> None:
        """``stamps``: those of the recorded states, ns."""
        self.linked = config.network is not None
        self._period_ns = config.period_ns
        self._seen: Integers = np.zeros(0, np.int64)
        self._told: Integers = self._seen
        if config.network is not None and len(stamps):
            wanted = int(stamps.max()) // config.period_ns + 1
            steps = max(min(wanted, 10 * len(stamps) + _FAR), 0)
            traffic = Traffic(config.network)
            self._seen, self._told = traffic.all_seen(steps), traffic.all_told(steps)

    @property
    def oldest(self) -> int:
        """The greatest age of a reading in the state in which it is seen, in steps."""
        return int((np.arange(len(self._seen)) - self._seen).max(initial=0))

    def seen_ns(self, stamp_ns: int) -> int:
        """Return the stamp of the state whose reading is seen at a stamp."""
        return self._of(self._seen, stamp_ns, stamp_ns)

    def told_ns(self, stamp_ns: int) -> int:
        """Return the stamp of the state whose command acts on the step from here, negative if none does."""
        return self._of(self._told, stamp_ns, stamp_ns)

    def seen(self, first: int, stop: int) -> Integers:
        """Return the steps whose readings are seen in these."""
        return self._seen[first:stop] if self.linked else np.arange(first, stop)

    def all_told_ns(self, stamps: Integers) -> Integers:
        """Return `told_ns` of many stamps."""
        if not len(self._told):
            return stamps
        steps = np.clip(stamps // self._period_ns, 0, len(self._told) - 1)
        return self._told[steps] * self._period_ns

    def _of(self, used: Integers, stamp_ns: int, otherwise: int) -> int:
        step = stamp_ns // self._period_ns
        return int(used[step]) * self._period_ns if 0 <= step < len(used) else otherwise
