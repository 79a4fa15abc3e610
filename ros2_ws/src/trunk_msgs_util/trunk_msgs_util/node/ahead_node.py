"""`AheadNode`: a node that knows ahead of time what holds in each state, and says so on one topic."""

from __future__ import annotations

from abc import abstractmethod
from typing import TypeVar

from trunk_core import topics
from trunk_core.parameters.shared import PeriodicConfig
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_core.units import LAST_STAMP_NS

from ..source import source_in
from . import discovery
from .base import TrunkNode
from .conversions import WireReader, sample_to_wire
from .endpoints import AdaptiveSubscription, ReplayablePublisher
from .ros_parameters import ConfigClass

Config = TypeVar("Config", bound=PeriodicConfig)


class AheadNode(TrunkNode[Config]):
    """Answers each true state with what holds in the next one, so that the simulator never waits for it.

    The first state is answered with its own value and the next one's, every other with the next one's.
    """

    def __init__(self, name: str, config_class: ConfigClass[Config], topic: str) -> None:
        super().__init__(name, config_class)
        self._topic = topic
        self._read = WireReader()
        self._publisher: ReplayablePublisher
        self.reconfigure(self.config)

    def set_up(self) -> None:
        """Listen for states."""
        self._sent_ns = -1
        self._publisher = self.create_replayable(self._topic)
        AdaptiveSubscription(self, topics.GROUND_TRUTH, self._on_state)
        self._ready_timer = self.every(0.02, self._announce)

    @abstractmethod
    def sample_at(self, stamp_ns: int) -> JointSample:
        """Return the sample for the state with this stamp."""

    def _announce(self) -> None:
        """Say ready once it is active and the simulator is matched in both directions."""
        if not self.active:
            return
        if discovery.matched(self, hears=topics.GROUND_TRUTH, answers=self._topic):
            self._ready_timer.cancel()
            self.event(Event.READY, answers=self._topic)

    def _on_state(self, data: bytes) -> None:
        if not self.active:
            return
        stamp_ns = self._read(data).stamp_ns
        next_ns = stamp_ns + self.config.period_ns
        if stamp_ns < 0 or next_ns > LAST_STAMP_NS:
            self.refuse("states malformed", f"a stamp of {stamp_ns} ns: at least 0 is needed")
            return
        if next_ns < self._sent_ns:  # the simulator has restarted, and time with it
            self.counters["states out of order"] += 1
            self._sent_ns = -1
            self.be_in_real_time(False)  # unless this run's states say so, too
        if source_in(self._read.frame_id):
            self.be_in_real_time(True)
        if self._sent_ns < stamp_ns:
            self._publish(stamp_ns)
        if self._sent_ns < next_ns:
            self._publish(next_ns)

    def _publish(self, stamp_ns: int) -> None:
        self._publisher.publish(sample_to_wire(self.sample_at(stamp_ns), self.source))
        self._sent_ns = self.run_stamp_ns = stamp_ns
