"""The test's own node in the graph: it subscribes, publishes, and calls services."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterEvent
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.node import middleware, qos
from trunk_msgs_util.node.conversions import sample_to_ros, stamp_from_ros

from .processes import Child

_ASK_AGAIN_S = 3.0
_ONCE = (ChangeState, Trigger)  # services for which it matters how often they are asked


class Event(NamedTuple):
    """A message on ``run/events``."""

    node: str
    message: str
    stamp_ns: int
    values: dict[str, str]


class Parameters(NamedTuple):
    """A message on ``run/parameters``."""

    node: str
    stamp_ns: int
    new: dict[str, Any]
    changed: dict[str, Any]


class Peer:
    """Collects what the graph publishes; every wait has a condition, as in `processes.until`."""

    def __init__(self, name: str = "peer") -> None:
        middleware.prepare()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node(name, context=self._context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.events: list[Event] = []
        self.parameters: list[Parameters] = []
        self.diagnostics: list[tuple[str, dict[str, str]]] = []
        self._listen(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.hear_run()

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _listen(
        self, kind: type, topic: str, callback: Callable[[Any], None], profile: Any
    ) -> None:
        self.node.create_subscription(kind, topic, callback, profile)

    def _on_event(self, message: DiagnosticArray) -> None:
        stamp_ns = stamp_from_ros(message.header.stamp)
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            self.events.append(Event(status.name, status.message, stamp_ns, values))

    def _on_parameters(self, message: ParameterEvent) -> None:
        new, changed = (
            {p.name: parameter_value_to_python(p.value) for p in listed}
            for listed in (message.new_parameters, message.changed_parameters)
        )
        stamp_ns = stamp_from_ros(message.stamp)
        self.parameters.append(Parameters(message.node, stamp_ns, new, changed))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics.append((status.name, {v.key: v.value for v in status.values}))

    def hear_run(self, namespace: str = "") -> None:
        """Collect what is known of a run in a namespace, from its beginning."""
        for kind, topic, callback in (
            (DiagnosticArray, topics.RUN_EVENTS, self._on_event),
            (ParameterEvent, topics.RUN_PARAMETERS, self._on_parameters),
        ):
            self._listen(kind, f"{namespace}/{topic}", callback, qos.run_information())

    def hear(self, topic: str) -> list[JointState]:
        """Return a list that fills with all that our nodes publish on a topic, past ones too."""
        heard: list[JointState] = []
        self._listen(JointState, topics.evidence(topic), heard.append, qos.evidence())
        return heard

    def hear_live(self, topic: str) -> list[JointState]:
        """Return a list that fills with what anybody publishes on a JointState topic from now on."""
        heard: list[JointState] = []
        self._listen(JointState, topic, heard.append, qos.live())
        return heard

    def speaker(self, topic: str) -> Callable[[JointSample], None]:
        """Return a function that publishes samples on a topic, once it has a subscriber."""
        publisher = self.node.create_publisher(JointState, topic, qos.evidence())
        self.until(publisher.get_subscription_count, f"somebody listens to {topic}")
        self._introduce(publisher)
        return lambda sample: publisher.publish(sample_to_ros(sample))

    def publisher(self, topic: str, *listeners: str) -> Publisher:
        """Return a publisher of samples, once all that listen hear it, the nodes ``listeners`` among them."""
        publisher = self.node.create_publisher(JointState, topic, qos.evidence())

        def heard() -> bool:
            known = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
            there = {one.node_name for one in known} >= {*listeners}
            return there and publisher.get_subscription_count() >= len(known)

        self.until(heard, f"{' and '.join(listeners)} listen to {topic}")
        self._introduce(publisher)
        return publisher

    def _introduce(self, publisher: Publisher) -> None:
        """Wait until the listeners know a publisher: until then they miss what it already sends them.

        What a participant of DDS has is announced in order: who answers a client that came later knows it.
        """

        def named() -> list[Any]:
            known = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
            return [] if "_NODE_NAME_UNKNOWN_" in {one.node_name for one in known} else known

        listeners = self.until(named, f"those who listen to {publisher.topic_name} have names")
        services = {name for name, _ in self.node.get_service_names_and_types()}
        for listener in listeners:
            state = f"{listener.node_namespace.rstrip('/')}/{listener.node_name}/get_state"
            if state in services:
                self.call(GetState, state)

    def spin(self, timeout_s: float = 0.0) -> None:
        """Take what has come, or comes within the time."""
        self._executor.spin_once(timeout_sec=timeout_s)

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Spin until the condition is truthy, and return it."""
        while not (found := condition()):
            self._executor.spin_once(timeout_sec=0.02)
        return found

    def until_event(self, node: str, message: str) -> Event:
        """Spin until a node has published this event on ``run/events``, and return the last one."""
        wanted = (f"/{node.lstrip('/')}", message)
        return self.until(
            lambda: next((e for e in reversed(self.events) if (e.node, e.message) == wanted), None),
            f"{node} says {message!r}",
        )

    def until_started(self, run: Child) -> None:
        """Spin until a run's simulator reports that it has started; the run must not end before."""

        def started_or_over() -> bool:
            over = run.process.poll() is not None
            return over or ("/simulator", "started") in {e[:2] for e in self.events}

        self.until(started_or_over, "the run has started")
        assert run.process.poll() is None, run.stderr

    def until_up(self, node: str) -> dict[str, Any]:
        """Spin until a node has published its parameters, and return them."""
        name = f"/{node.lstrip('/')}"
        return self.until(
            lambda: next((p.new for p in self.parameters if p.node == name and p.new), None),
            f"{node} publishes its parameters",
        )

    def last_diagnostics(self, node: str) -> dict[str, str]:
        """Return a node's last message on /diagnostics so far; wait for one if there is none."""
        name = f"/{node.lstrip('/')}"
        return self.until(
            lambda: [v for n, v in self.diagnostics if n == name], f"{node} diagnoses"
        )[-1]

    def fresh_diagnostics(self, node: str) -> dict[str, str]:
        """Return a node's second message on /diagnostics from now on."""
        seen, name = len(self.diagnostics), f"/{node.lstrip('/')}"
        return self.until(
            lambda: [v for n, v in self.diagnostics[seen:] if n == name][1:], f"{node} diagnoses"
        )[0]

    def until_recorded(self, messages: int, node: str = "recorder") -> None:
        """Spin until a recorder reports that many messages in its file."""

        def recorded() -> bool:
            said = [v for n, v in self.diagnostics if n == f"/{node}"]
            return bool(said) and int(said[-1]["messages"]) >= messages

        self.until(recorded, f"{messages} messages are recorded")

    def until_received(self, publisher: Publisher) -> None:
        """Wait until every reliable reader has what this publisher published, lost packets sent again."""
        assert publisher.wait_for_all_acked()

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """Call a service and return its response.

        A response sent before the server has matched the client is lost: then it is asked again, if it may be
        asked twice. Otherwise the node is asked for its state by a client that is made later, first:
        discovery keeps their order, so that a node which has answered the one has matched the other.
        """
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f"{name} is there")
        if kind in _ONCE:
            self.call(GetState, f"{name.rpartition('/')[0]}/get_state")
        futures: list[Any] = []
        asked = -_ASK_AGAIN_S

        def answered() -> Any:
            nonlocal asked
            if time.monotonic() - asked > _ASK_AGAIN_S and not (futures and kind in _ONCE):
                asked = time.monotonic()
                futures.append(client.call_async(kind.Request(**fields)))
            return next((future for future in futures if future.done()), None)

        future = self.until(answered, f"{name} answers")
        self.node.destroy_client(client)
        return future.result()
