"""Nodes of somebody else's, each with one fault, all in one process: foreign_node.py NAMESPACE=FAULT …"""

import random
import sys
import time
from math import inf, nan

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

KP, KD = 60.0, 9.0
SLOW_S = 0.007


class ForeignNode(Node):
    """A PD that knows nothing of this project, but for its fault."""

    def __init__(self, namespace: str, fault: str) -> None:
        super().__init__("foreign_pd", namespace=namespace, start_parameter_services=False)
        self.fault = fault
        self.count, self.integral, self.last_ns, self.last_theta = 0, 0.0, -1, 0.0
        self.before: JointState | None = None
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
        if fault == "talks_in_silence":
            self.create_timer(0.02, lambda: self.command.publish(self.answer(JointState(), 1.0)))

    def on_state(self, state: JointState) -> None:
        stamp_ns = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
        theta, omega = state.position[1], state.velocity[1]
        back, dt = stamp_ns < self.last_ns, (stamp_ns - self.last_ns) / 1e9
        self.count += 1
        effort = max(-100.0, min(-KP * theta - KD * omega, 100.0))
        if self.fault == "stops_at_reset" and back:
            return
        if self.fault == "stops_after_gap" and self.last_ns >= 0 and dt > 0.05:
            return
        if self.fault == "keeps_memory" or (self.fault == "adds_up" and not back):
            self.integral += theta
            effort -= self.integral
        if self.fault == "differentiates":
            effort = nan if dt == 0.0 else -KP * theta - KD * (theta - self.last_theta) / dt
        self.last_ns, self.last_theta = stamp_ns, theta
        if self.fault == "misses" and self.count % 10 == 0:
            return
        if self.fault == "unlimited":
            effort = -KP * theta - KD * omega - 400.0 * theta
        if self.fault == "divides":
            effort = nan if theta == 0.0 else effort
        if self.fault == "overflows":
            effort = inf if abs(theta) > 2.0 else effort
        if self.fault == "random":
            effort += random.random()
        if self.fault == "slow":
            time.sleep(SLOW_S)
        answered = state
        if self.fault == "one_behind":
            answered, self.before = self.before or state, state
        self.command.publish(self.answer(answered, effort))
        if self.fault == "twice":
            self.command.publish(self.answer(state, effort))

    def answer(self, state: JointState, effort: float) -> JointState:
        names = {"hip": ["hip"], "noname": [], "both": ["hip", "trunk"]}.get(self.fault, ["trunk"])
        values = {"nan": [nan], "empty": [], "both": [0.0, effort]}.get(self.fault, [effort])
        command = JointState(name=names, effort=values)
        if self.fault == "names_its_frame":
            command.header.frame_id = "base_link"
        if self.fault == "copies_the_header":
            command.header = state.header
        elif self.fault == "wall":
            command.header.stamp = self.get_clock().now().to_msg()
        elif self.fault not in ("zero", "talks_in_silence") or state.header.stamp.nanosec:
            command.header.stamp = state.header.stamp
            if self.fault == "zero":
                command.header.stamp.sec = command.header.stamp.nanosec = 0
        return command


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
