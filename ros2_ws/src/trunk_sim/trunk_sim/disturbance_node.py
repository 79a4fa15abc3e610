"""The ``disturbance`` node: open-loop disturbances, stamped with the instant at which they act."""

from __future__ import annotations

from trunk_msgs_util import topics
from trunk_msgs_util.node.ahead_node import AheadNode
from trunk_msgs_util.node.run import main_for
from trunk_msgs_util.samples import JointSample

from .disturbance_config import DisturbanceConfig
from .disturbances import disturbance_at, disturbance_sample


class DisturbanceNode(AheadNode[DisturbanceConfig]):
    """Publishes what acts in each state one step ahead."""

    def __init__(self) -> None:
        super().__init__("disturbance", DisturbanceConfig, topics.DISTURBANCE)

    def reconfigure(self, config: DisturbanceConfig) -> None:
        """Take changed signals; they act from the next stamp on."""
        self._signals = config.signals

    @property
    def period_ns(self) -> int:
        """The plant's period, ns."""
        return self.config.period_ns

    def sample_at(self, stamp_ns: int) -> JointSample:
        """Return the disturbance in the state with this stamp."""
        disturbance = disturbance_at(stamp_ns, self._signals)
        return disturbance_sample(stamp_ns, self.config.joints, disturbance)


main = main_for(DisturbanceNode, "disturbance")
