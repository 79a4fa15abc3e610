"""The ``pid`` node: PID with constant gains."""

from __future__ import annotations

from trunk_msgs_util.node.run import main_for

from .config import PidConfig
from .controller import PidController
from .controller_node import ControllerNode


class PidNode(ControllerNode):
    """`PidController` in the graph."""

    def __init__(self) -> None:
        super().__init__("pid", PidConfig, PidController)


main = main_for(PidNode, "pid")
