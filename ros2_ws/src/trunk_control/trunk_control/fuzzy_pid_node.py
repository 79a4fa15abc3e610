"""The ``fuzzy_pid`` node: PID with gains inferred at each sample."""

from __future__ import annotations

from trunk_msgs_util.node.run import main_for

from .config import FuzzyPidConfig
from .controller import FuzzyPidController
from .controller_node import ControllerNode


class FuzzyPidNode(ControllerNode):
    """`FuzzyPidController` in the graph."""

    def __init__(self) -> None:
        super().__init__("fuzzy_pid", FuzzyPidConfig, FuzzyPidController)


main = main_for(FuzzyPidNode, "fuzzy_pid")
