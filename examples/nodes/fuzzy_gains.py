#!/usr/bin/env python3
"""Only Fuzzy-PID's gains, for another project's PID: python3 fuzzy_gains.py, beside trunk run or a robot.

It publishes the gains (Kp, Ki, Kd) that ``fuzzy_pid`` infers from the same states and reference::

    u = Kp e + Ki (integral of e) + Kd (de/dt)     N m/rad, N m/(rad s), N m s/rad

Its parameters are those of ``fuzzy_pid``; the limits of the torque change nothing here.
"""

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from trunk_control.controller import Controller
from trunk_control.controller_node import Inputs
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_core.errors import TrunkError
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.ros_parameters import NodeParameters

LAYOUT = MultiArrayLayout(dim=[MultiArrayDimension(label="p i d", size=3, stride=3)])


class FuzzyGains(Node):
    """Sends no commands: nothing waits for it, and nothing of it is recorded."""

    def __init__(self):
        super().__init__(
            "fuzzy_gains", start_parameter_services=False
        )  # created with the parameters
        config = NodeParameters(self, FuzzyPidConfig, self.reconfigure).config
        self.controller = Controller(config)
        self.gains = self.create_publisher(Float64MultiArray, "~/gains", qos.live())
        self.inputs = Inputs(config, self.refuse)
        self.inputs.follow(self, self.on_reading)

    def reconfigure(self, old, new):
        """Take changed parameters."""
        self.controller.reconfigure(new)
        self.inputs.reconfigure(new)

    def refuse(self, what, why):
        """Say why messages are not used."""
        self.get_logger().warning(f"{what}: {why}", throttle_duration_sec=5.0)

    def on_reading(self, reading):
        """Publish the gains of an update."""
        output = self.controller.decide(reading)
        if output.updated:
            terms = output.terms
            data = [terms.kp, terms.ki, terms.kd]
            self.gains.publish(Float64MultiArray(layout=LAYOUT, data=data))


def main():
    """Publish gains until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(FuzzyGains())
    except TrunkError as error:  # a parameter that is not allowed
        sys.exit(f"fuzzy_gains: {error}")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
