"""A controller of somebody else's: it answers states with torques and names no source.

    python stranger.py GAIN FRAME

A process of its own, of which only rclpy is asked.
"""

from __future__ import annotations

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState


def main() -> None:
    """Answer states until a signal comes."""
    gain, frame = float(sys.argv[1]), sys.argv[2]
    rclpy.init()
    node = Node("stranger")
    publisher = node.create_publisher(JointState, "effort_command", 10)

    def answer(state: JointState) -> None:
        command = JointState(name=["trunk"], effort=[-gain * state.position[1]])
        command.header.stamp = state.header.stamp
        command.header.frame_id = frame
        publisher.publish(command)

    node.create_subscription(JointState, "joint_states", answer, 10)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main()
