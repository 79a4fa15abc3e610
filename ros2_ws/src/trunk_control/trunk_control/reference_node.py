"""The ``reference`` node: the scenario's reference on a topic, for controllers that are not ours."""

from __future__ import annotations

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.node.ahead_node import AheadNode
from trunk_msgs_util.node.execution import main_for

from .reference import ReferenceConfig, reference_at


class ReferenceNode(AheadNode[ReferenceConfig]):
    """Publishes each state's reference one step ahead: before the state that it is for."""

    def __init__(self) -> None:
        super().__init__("reference", ReferenceConfig, topics.REFERENCE)

    def reconfigure(self, config: ReferenceConfig) -> None:
        """Take a changed profile; it holds from the next stamp on."""
        self._profile = config.reference

    def sample_at(self, stamp_ns: int) -> JointSample:
        """Return the reference of the state with this stamp, rad."""
        return JointSample(stamp_ns, (self.config.joint,), (reference_at(stamp_ns, self._profile),))


main = main_for(ReferenceNode, "reference")
