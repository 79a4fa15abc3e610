"""What is seen of a run in progress: events, progress, a second node of the same name."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from trunk_core import topics
from trunk_core.topics import Event
from trunk_msgs_util.node import middleware, qos
from trunk_msgs_util.node.discovery import Wait


class Monitor:
    """Listens to ``run/events`` and ``/diagnostics``; a context manager that owns its ROS context."""

    def __init__(self) -> None:
        self.started = False
        self.finished = False  # the simulator has reported the run as whole
        self.signs_of_life = 0  # of the simulator
        self.ready: set[str] = set()
        self._processes: defaultdict[str, set[str]] = defaultdict(set)  # of each node's name
        # Of each event the node, the message and the values; who has read them clears them.
        self.events: list[tuple[str, str, Mapping[str, str]]] = []
        self.waits_for = Wait()  # as the simulator says
        self.overdue = ""  # what the user was told of that
        self.failure: str | None = None
        self.time = 0.0
        middleware.prepare()
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("run_monitor", context=self._context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._node.create_subscription(
            DiagnosticArray, topics.RUN_EVENTS, self._on_event, qos.run_information()
        )
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def __enter__(self) -> Monitor:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def spin(self, timeout_s: float) -> None:
        """Take the messages that have arrived, or wait for one."""
        self._executor.spin_once(timeout_sec=timeout_s)

    def doubled(self, own: Mapping[str, str]) -> list[str]:
        """Return which of our nodes' names are used twice; ``own`` are the processes of ours, by node.

        Nodes report their own process: discovery may for a while list a node that is gone.
        """
        return [name for name, process in own.items() if self._processes[name] - {process}]

    def _on_event(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            self.signs_of_life += status.name == "/simulator"
            self.events.append((status.name, status.message, values))
            if status.message == Event.STARTED:
                self.started = True
            elif status.message == Event.FINISHED:
                self.finished = True
            elif status.message == Event.READY:
                self.ready.add(status.name.lstrip("/"))
            elif status.message == Event.CONFIGURED:
                self._processes[status.name.lstrip("/")].add(values.get("process", ""))
            elif status.message in (Event.FAILED, Event.STOPPED):
                self.failure = f"{status.name.lstrip('/')}: {values.get('reason', 'failed')}"

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/simulator":  # not one in another namespace: the topic is shared
                values = {v.key: v.value for v in status.values}
                self.signs_of_life += 1
                self.time = float(values.get("time", self.time))
                waits = (values.get(name, "") for name in ("waiting for", "seen instead"))
                self.waits_for = Wait(*waits)
                self.started = self.started or self.time > 0.0
