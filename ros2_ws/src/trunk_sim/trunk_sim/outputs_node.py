"""What the plant publishes for each state: the time, its true and measured state, what acts on it."""

from __future__ import annotations

from rosgraph_msgs.msg import Clock

from trunk_msgs_util import topics
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.conversions import sample_to_wire, stamp_to_ros
from trunk_msgs_util.samples import JointSample

from .config import SimulatorConfig
from .inputs import Command, Disturbed, inputs_frame, inputs_row


class PlantOutputs:
    """Publishes on behalf of the simulator."""

    def __init__(self, node: TrunkNode[SimulatorConfig], config: SimulatorConfig) -> None:
        self._node = node
        self._truth = node.create_replayable(topics.GROUND_TRUTH)
        self._measured = node.create_replayable(topics.JOINT_STATES)
        self._inputs = None  # in lock-step they follow from the messages
        if not config.lockstep:
            self._inputs = node.create_replayable(topics.PLANT_INPUTS, live=False)
        self._inputs_until_ns = -1
        self._clock = (
            node.create_publisher(Clock, "/clock", qos.clock()) if config.publish_clock else None
        )

    def clock(self, stamp_ns: int) -> None:
        """Publish the time before any message stamped with it: no node sees a state from the future."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp_to_ros(stamp_ns)))

    def truth(self, sample: JointSample) -> None:
        """Publish the true state."""
        self._truth.publish(sample_to_wire(sample, self._node.source))

    def measured(self, sample: JointSample) -> None:
        """Publish the state as it reaches the controllers."""
        self._measured.publish(sample_to_wire(sample, self._node.source))

    def inputs(self, stamp_ns: int, command: Command, disturbed: Disturbed) -> None:
        """Publish what acts in a state, once: a plant that diverges has already published it as the last."""
        if self._inputs is None or stamp_ns <= self._inputs_until_ns:
            return
        self._inputs_until_ns = stamp_ns
        frame = inputs_frame(self._node.source, command, disturbed)
        self._inputs.publish(sample_to_wire(inputs_row(stamp_ns, command, disturbed), frame))
