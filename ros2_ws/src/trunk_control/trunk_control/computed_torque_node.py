"""The ``computed_torque`` node: inverse dynamics of a model with measured hip."""

from __future__ import annotations

from trunk_msgs_util.node.run import main_for

from .controller_node import ControllerNode
from .model_config import ComputedTorqueConfig
from .model_controller import ComputedTorqueController


class ComputedTorqueNode(ControllerNode):
    """`ComputedTorqueController` in the graph."""

    def __init__(self) -> None:
        super().__init__("computed_torque", ComputedTorqueConfig, ComputedTorqueController)


main = main_for(ComputedTorqueNode, "computed_torque")
