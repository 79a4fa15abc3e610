"""The ``disturbance`` node: open-loop disturbances, stamped with the instant at which they act."""

from __future__ import annotations

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.node.ahead_node import AheadNode
from trunk_msgs_util.node.execution import main_for

from .disturbance_config import DisturbanceConfig, disturbance_class
from .disturbances import disturbance_at, disturbance_sample


class DisturbanceNode(AheadNode[DisturbanceConfig]):
    """Publishes what acts in each state one step ahead."""

    def __init__(self) -> None:
        super().__init__("disturbance", disturbance_class, topics.DISTURBANCE)

    def reconfigure(self, config: DisturbanceConfig) -> None:
        """Take changed signals; they act from the next stamp on."""
        self._signals = config.signals

    def sample_at(self, stamp_ns: int) -> JointSample:
        """Return the disturbance in the state with this stamp."""
        disturbance = disturbance_at(stamp_ns, self._signals)
        return disturbance_sample(stamp_ns, self.config.joints, disturbance)


main = main_for(DisturbanceNode, "disturbance")
