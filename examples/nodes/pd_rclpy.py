#!/usr/bin/env python3
"""A PD controller with rclpy: python3 pd_rclpy.py, beside trunk run SCENARIO --external."""

from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

KP, KD, LIMIT = 60.0, 9.0, 100.0  # N m/rad, N m s/rad, N m


class PD(Node):
    """u = Kp (reference - angle) - Kd rate, for each state."""

    def __init__(self):
        super().__init__("my_pd")
        reliable = QoSProfile(depth=100)
        self.reference, self.ahead = 0.0, {}  # rad; by stamp
        self.command = self.create_publisher(JointState, "effort_command", reliable)
        self.create_subscription(JointState, "reference", self.on_reference, reliable)
        self.create_subscription(JointState, "joint_states", self.on_state, reliable)

    def on_reference(self, message):
        """Keep a reference, rad, for the state that has its stamp."""
        self.ahead[str(message.header.stamp)] = message.position[message.name.index("trunk")]

    def on_state(self, state):
        """Answer a state: its stamp, the joint's name, a torque in N m."""
        trunk = state.name.index("trunk")
        self.reference = self.ahead.pop(str(state.header.stamp), self.reference)
        torque = KP * (self.reference - state.position[trunk]) - KD * state.velocity[trunk]
        command = JointState(name=["trunk"], effort=[max(-LIMIT, min(torque, LIMIT))])
        command.header.stamp = state.header.stamp
        self.command.publish(command)


def main():
    """Answer until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(PD())


if __name__ == "__main__":
    main()
