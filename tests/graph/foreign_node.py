"""Nodes of somebody else's, each with one fault, all in one process: foreign_node.py NAMESPACE=FAULT …"""

import sys

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

KP, KD = 60.0, 9.0


class ForeignNode(Node):
    """A PD that knows nothing of this project, but for its fault."""

    def __init__(self, namespace: str, fault: str) -> None:
        super().__init__("foreign_pd", namespace=namespace, start_parameter_services=False)
        self.fault = fault
        reliable = QoSProfile(depth=100)
        best = fault == "best_effort"
        self.command = self.create_publisher(
            JointState,
            "effort_command",
            QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT) if best else reliable,
        )
        asked = QoSProfile(depth=100)
        if fault == "durability":
            asked.durability = DurabilityPolicy.TRANSIENT_LOCAL
        elif fault == "deadline":
            asked.deadline = Duration(seconds=0.05)
        self.create_subscription(JointState, "joint_states", self.on_state, asked)

    def on_state(self, state: JointState) -> None:
        theta, omega = state.position[1], state.velocity[1]
        effort = max(-100.0, min(-KP * theta - KD * omega, 100.0))
        joint = "hip" if self.fault == "hip" else "trunk"
        command = JointState(name=[joint], effort=[effort])
        if self.fault == "names_its_frame":
            command.header.frame_id = "base_link"
        if self.fault == "copies_the_header":
            command.header = state.header
        elif self.fault == "wall":
            command.header.stamp = self.get_clock().now().to_msg()
        elif self.fault != "zero":
            command.header.stamp = state.header.stamp
        self.command.publish(command)


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    for argument in sys.argv[1:]:
        namespace, fault = argument.split("=")
        executor.add_node(ForeignNode(namespace, fault))
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main()
