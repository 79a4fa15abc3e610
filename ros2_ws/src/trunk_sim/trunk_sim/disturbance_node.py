"""The ``disturbance`` node: open-loop disturbances, stamped with the instant at which they act."""

from __future__ import annotations

from sensor_msgs.msg import JointState

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node import meeting, qos
from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.conversions import WireReader, sample_to_wire
from trunk_msgs_util.node.run import main_for
from trunk_msgs_util.source import source_in
from trunk_msgs_util.units import LAST_STAMP_NS

from .disturbance_config import DisturbanceConfig
from .disturbances import disturbance_at, disturbance_sample


class DisturbanceNode(TrunkNode[DisturbanceConfig]):
    """Answers each true state with what acts at the next one.

    A disturbance is known ahead of time, so that the simulator never waits for it: the first state is
    answered with its own disturbance and the next one's, every other with the next one's.
    """

    def __init__(self) -> None:
        super().__init__("disturbance", DisturbanceConfig)
        self._read = WireReader()
        self.retune(self.config)

    def set_up(self) -> None:
        """Listen for states."""
        self._sent_ns = -1
        self._publisher = self.create_evidence(topics.DISTURBANCE)
        self.create_subscription(
            JointState, topics.GROUND_TRUTH, self._on_state, qos.control(), raw=True
        )
        self._ready_timer = self.every(0.02, self._announce)

    def retune(self, config: DisturbanceConfig) -> None:
        """Take changed signals; they act from the next stamp on."""
        self._signals = config.signals
        self._period_ns = config.period_ns

    def _announce(self) -> None:
        """Say ready once it is active and the simulator is matched in both directions."""
        if not self.active:
            return
        if meeting.met(self, hears=topics.GROUND_TRUTH, answers=topics.DISTURBANCE):
            self._ready_timer.cancel()
            self.event(Event.READY, answers=topics.DISTURBANCE)

    def _on_state(self, data: bytes) -> None:
        if not self.active:
            return
        stamp_ns = self._read(data).stamp_ns
        next_ns = stamp_ns + self._period_ns
        if stamp_ns < 0 or next_ns > LAST_STAMP_NS:
            self.counters["states malformed"] += 1
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
        acting = disturbance_at(stamp_ns, self._signals)
        sample = disturbance_sample(stamp_ns, self.config.joints, acting)
        self._publisher.publish(sample_to_wire(sample, self.source))
        self._sent_ns = self.run_stamp_ns = stamp_ns


main = main_for(DisturbanceNode, "disturbance")
