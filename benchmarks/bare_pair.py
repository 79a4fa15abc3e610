"""Bare pairs of rclpy processes that only echo the messages of a loop.

The yardsticks of the benchmarks ``lockstep`` (``ping`` and ``echo``) and ``realtime`` (``timer`` and
``answer``): the cost of a round trip without any plant or controller.
"""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.node import early_signals
from trunk_msgs_util.node.conversions import sample_to_ros

_JOINTS = JointSample(0, ("hip", "trunk"), (0.1, 0.2), (0.3, 0.4), (0.5, 0.6))
_COMMAND = JointSample(0, ("trunk",), effort=(0.7,))
_TERMS = JointSample(0, law_named("pid").record_names, position=tuple(map(float, range(13))))


def ping(trips: int) -> None:
    """Publish states, each after the answer to the last; print ``trips`` and seconds."""
    node = Node("bare_ping")
    measured = node.create_publisher(JointState, topics.JOINT_STATES, 10)
    truth = node.create_publisher(JointState, topics.GROUND_TRUTH, 10)
    message = sample_to_ros(_JOINTS)
    done = 0
    started = 0.0

    def publish() -> None:
        measured.publish(message)
        truth.publish(message)

    def on_answer(_: JointState) -> None:
        nonlocal done
        done += 1
        if done <= trips:
            publish()

    node.create_subscription(JointState, topics.EFFORT_COMMAND, on_answer, 10)
    while not (measured.get_subscription_count() and node.count_publishers(topics.EFFORT_COMMAND)):
        rclpy.spin_once(node, timeout_sec=0.05)
    while done == 0:  # until the other side is matched too
        publish()
        rclpy.spin_once(node, timeout_sec=0.2)
    executor = rclpy.get_global_executor()
    executor.add_node(node)
    done = 0
    publish()
    started = time.monotonic()
    while done <= trips:
        executor.spin_once(timeout_sec=5.0)
    print(f"finished: {trips} steps in {time.monotonic() - started:.6f} s of wall time", flush=True)


def echo() -> None:
    """Answer each state with a command and a record of terms, until told to stop."""
    node = Node("bare_echo")
    command = node.create_publisher(JointState, topics.EFFORT_COMMAND, 10)
    terms = node.create_publisher(JointState, "bare/state", 10)
    answer, record = sample_to_ros(_COMMAND), sample_to_ros(_TERMS)

    def on_state(_: JointState) -> None:
        command.publish(answer)
        terms.publish(record)

    node.create_subscription(JointState, topics.JOINT_STATES, on_state, 10)
    rclpy.spin(node)


def timer(rate: float) -> None:
    """Publish a state ``rate`` times a second from a steady timer, until told to stop."""
    node = Node("bare_timer")
    states = node.create_publisher(JointState, topics.JOINT_STATES, 10)
    message = sample_to_ros(_JOINTS)

    def publish() -> None:
        message.header.stamp = node.get_clock().now().to_msg()
        states.publish(message)

    node.create_timer(1.0 / rate, publish, clock=Clock(clock_type=ClockType.STEADY_TIME))
    rclpy.spin(node)


def answer() -> None:
    """Publish each received state back as its command, until told to stop."""
    node = Node("bare_answer")
    command = node.create_publisher(JointState, topics.EFFORT_COMMAND, 10)
    node.create_subscription(JointState, topics.JOINT_STATES, command.publish, 10)
    rclpy.spin(node)


def main() -> None:
    """Run ``ping TRIPS``, ``echo``, ``timer HZ`` or ``answer``."""
    part, *values = sys.argv[1:]
    rclpy.init()
    try:
        if part == "ping":
            ping(int(values[0]))
        elif part == "timer":
            timer(float(values[0]))
        elif part == "answer":
            answer()
        else:
            echo()
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    rclpy.try_shutdown()


if __name__ == "__main__":
    early_signals.unblock()
    main()
