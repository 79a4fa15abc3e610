"""The ``lqr`` node: state feedback with gains from a Riccati equation, and a feed-forward."""

from __future__ import annotations

from trunk_msgs_util.node.run import main_for

from .controller_node import ControllerNode
from .model_config import LqrConfig
from .model_controller import LqrController


class LqrNode(ControllerNode):
    """`LqrController` in the graph."""

    def __init__(self) -> None:
        super().__init__("lqr", LqrConfig, LqrController)


main = main_for(LqrNode, "lqr")
