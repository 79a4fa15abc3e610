"""A process that prints what it hears of a run, a JSON object a line: ``torque`` or ``diagnostics``."""

import json
import signal
from threading import Event

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from trunk_core import topics
from trunk_msgs_util.node import middleware, qos


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


def diagnose(message: DiagnosticArray) -> None:
    for status in message.status:
        if status.name == "/simulator":
            say(diagnostics={v.key: v.value for v in status.values})


def main() -> None:
    ended = Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    middleware.prepare()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node("listener", start_parameter_services=False)
    node.create_subscription(
        JointState, topics.GROUND_TRUTH, lambda state: say(torque=state.effort[1]), qos.live()
    )
    node.create_subscription(DiagnosticArray, "/diagnostics", diagnose, 100)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
