"""The ``markers`` node: the run as visualization_msgs/MarkerArray, for RViz and Foxglove.

It takes no part in the run: it shows the latest messages at its own pace, nothing waits for it, and it
leaves no trace in the record.
"""

from __future__ import annotations

import sys
import time

from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from trunk_core import topics
from trunk_core.parameters.declarations import values_of
from trunk_core.samples import JointSample
from trunk_core.text import printable
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import WireReader
from trunk_msgs_util.node.execution import LoopExecutor, run_beside
from trunk_msgs_util.node.ros_parameters import NodeParameters
from trunk_msgs_util.picture.film import Film, markers, scene_of, value
from trunk_msgs_util.picture.shapes import shapes
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.config import TrunkSimulator

from .markers import MarkersConfig


class Newest:
    """The latest sample of a topic."""

    def __init__(self, node: Node, topic: str) -> None:
        self.sample: JointSample | None = None
        self._read = WireReader()
        node.create_subscription(JointState, topic, self._take, qos.view(), raw=True)

    def _take(self, data: bytes) -> None:
        self.sample = self._read(data)


class MarkersNode(Node):
    """Publishes the picture of the latest state; the plant's constants come from ``run/parameters``."""

    def __init__(self) -> None:
        """Declare and check the parameters. Raises ParameterError."""
        super().__init__("markers", start_parameter_services=False)  # made with the parameters
        self._parameters_set = NodeParameters(self, MarkersConfig, lambda old, new: None)
        self._film = Film()
        self._film.reconfigure(values_of(TrunkSimulator()), {})
        self._truth = Newest(self, topics.GROUND_TRUTH)
        self._disturbance = Newest(self, topics.DISTURBANCE)
        self._terms = [Newest(self, topics.controller_state(c)) for c in CONTROLLERS]
        self._shown: JointSample | None = None
        self._picture = self.create_publisher(MarkerArray, topics.MARKERS, 1)
        self.create_subscription(
            ParameterEvent, topics.RUN_PARAMETERS, self._on_parameters, qos.run_information()
        )

    @property
    def config(self) -> MarkersConfig:
        """The active configuration."""
        return self._parameters_set.config

    def _on_parameters(self, event: ParameterEvent) -> None:
        if event.node.endswith("/simulator"):
            new, changed = (
                {
                    parameter.name: parameter_value_to_python(parameter.value)
                    for parameter in parameters
                }
                for parameters in (event.new_parameters, event.changed_parameters)
            )
            if problem := self._film.reconfigure(new, changed):
                self.get_logger().warning(printable(problem))

    def show(self) -> None:
        """Publish the picture if there is a new state."""
        if self._truth.sample is self._shown:
            return
        self._shown, geometry = self._truth.sample, self._film.geometry
        if self._shown is None or geometry is None:
            return
        scene = scene_of(geometry, self._shown, self._disturbance.sample, self._reference())
        if scene is not None:
            now_ns = self.get_clock().now().nanoseconds
            drawn = shapes(geometry, scene)
            self._picture.publish(markers(drawn, now_ns, self.config.frame))

    def _reference(self) -> float | None:
        """Return the reference of the controller that published last."""
        speaking = [terms for terms in self._terms if terms.sample is not None]
        latest = max(speaking, key=lambda t: t.sample.stamp_ns if t.sample else -1, default=None)
        return value(latest.sample, "position", "reference") if latest else None


def _turn(node: MarkersNode, executor: LoopExecutor) -> None:
    # Messages that arrive in between do not wake it: each queue keeps only the latest.
    time.sleep(1.0 / node.config.rate)
    executor.spin_once(timeout_sec=0.0)
    node.show()


def main() -> None:
    """Show the latest state at the set rate until told to stop."""
    sys.exit(run_beside(MarkersNode, _turn, "markers"))
