"""The ``fuzzy_gains`` node: only Fuzzy-PID's gains, for another project's PID.

It takes no part in a run: it sends no commands, nothing waits for it, and nothing of it is recorded.
"""

from __future__ import annotations

import sys
import time
from collections import Counter

from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from trunk_msgs_util.node import qos
from trunk_msgs_util.node.executor import LoopExecutor
from trunk_msgs_util.node.ros_parameters import NodeParameters
from trunk_msgs_util.node.run import run_beside
from trunk_msgs_util.text import printable

from .controller import Controller
from .controller_node import Inputs
from .decide import Reading
from .fuzzy_pid import FuzzyPidConfig

NAME = "fuzzy_gains"
GAINS = "~/gains"
_WARN_EVERY_S = 5.0
_LAYOUT = MultiArrayLayout(dim=[MultiArrayDimension(label="p i d", size=3, stride=3)])


class GainsNode(Node):
    """Publishes the gains (Kp, Ki, Kd) that ``fuzzy_pid`` infers from the same states and reference.

    ::

        u = Kp e + Ki (integral of e) + Kd (de/dt)     N m/rad, N m/(rad s), N m s/rad

    Its parameters are those of ``fuzzy_pid``; the limits of the torque change nothing here.
    """

    def __init__(self) -> None:
        """Declare and check the parameters. Raises ParameterError."""
        super().__init__(NAME, start_parameter_services=False)  # created with the parameters
        self._parameters_set = NodeParameters(self, FuzzyPidConfig, self._reconfigure)
        config = self._parameters_set.config
        self._controller = Controller(config)
        self._counters: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._warned = 0
        self._warn_after_s = 0.0  # by the monotonic clock
        self._gains = self.create_publisher(Float64MultiArray, GAINS, qos.live())
        self._inputs = Inputs(config, self._refuse)
        self._inputs.follow(self, self._on_reading)

    def _reconfigure(self, old: FuzzyPidConfig, new: FuzzyPidConfig) -> None:
        self._controller.reconfigure(new)
        self._inputs.reconfigure(new)

    def _refuse(self, kind: str, why: str) -> None:
        self._counters[kind] += 1
        self._reasons[kind] = why

    def _on_reading(self, reading: Reading) -> None:
        output = self._controller.decide(reading)
        if output.updated:
            terms = output.terms
            self._gains.publish(
                Float64MultiArray(layout=_LAYOUT, data=[terms.kp, terms.ki, terms.kd])
            )

    def turn(self, executor: LoopExecutor) -> None:
        """Handle what has arrived; log what could not be used."""
        executor.spin_once(timeout_sec=0.1)
        now = time.monotonic()
        if self._counters.total() > self._warned and now > self._warn_after_s:
            self._warned, self._warn_after_s = self._counters.total(), now + _WARN_EVERY_S
            counts = self._counters.items()
            lines = (f"{kind} ({count}): {self._reasons[kind]}" for kind, count in counts)
            self.get_logger().warning(printable("; ".join(lines)))


def main() -> None:
    """Publish gains until a signal ends it."""
    sys.exit(run_beside(GainsNode, GainsNode.turn, NAME))
