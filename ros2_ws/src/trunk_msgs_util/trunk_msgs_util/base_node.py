"""What every node of the project shares: parameters, run events, diagnostics, a managed life, an end."""

from __future__ import annotations

import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any, Generic, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterEvent
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.qos import qos_policy_name_from_kind
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from . import middleware, qos, topics
from .config import ManagedConfig
from .conversions import status_to_ros
from .declarations import ParameterError, values_of
from .executor import LoopExecutor
from .parameters import NodeParameters

RCLError = rclpy_implementation.RCLError
Config = TypeVar("Config", bound=ManagedConfig)

EXIT_FAILED = 1
EXIT_USAGE = 2
_ACKNOWLEDGE_S = 1.0
_DRAIN_S = 0.7


class TrunkNode(LifecycleNode, Generic[Config]):
    """A managed node with a checked configuration, which tells the run's record what happens to it.

    Parameters, run events and diagnostics are there from the beginning; a subclass fills in `set_up`,
    `activate`, `deactivate` and `tear_down`, which ROS 2's transitions call.

    ``run_stamp_ns`` is the stamp of the last state that the node dealt with; events and changes of
    parameters carry it. A change applies from the first state with a greater stamp on.
    """

    def __init__(self, name: str, config_class: type[Config]) -> None:
        """Declare and check the parameters. Raises ParameterError."""
        super().__init__(name, start_parameter_services=False)  # they are made with the parameters
        self.configured = False
        self.active = False
        self._refusal: ParameterError | None = None
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        self.run_stamp_ns = -1  # before the first state
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.counters: Counter[str] = Counter()
        self.linger_s = 0.0  # messages may gather for so long before they are taken
        self.exit_code: int | None = None  # set: the node is done and its process ends
        self._parameters_set = NodeParameters(self, config_class, self._on_parameters)
        self._parameters_topic = self.create_publisher(
            ParameterEvent, topics.RUN_PARAMETERS, qos.run_information()
        )
        self._events_topic = self.create_publisher(
            DiagnosticArray, topics.RUN_EVENTS, qos.run_information()
        )
        self._diagnostics_topic = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._parameters_topic.publish(self._parameters_set.event(0))
        self._diagnostics_timer = self.every(1.0, self._publish_diagnostics)
        self._permanent = {id(entity) for entity in self._entities()}

    # A managed node's life. What a subclass has to do at each transition:

    def set_up(self) -> None:
        """Make topics, services, files: from unconfigured to inactive. Raises ParameterError."""

    def activate(self) -> None:
        """Begin, or go on."""

    def deactivate(self) -> None:
        """Hold; what is there is kept."""

    def tear_down(self) -> None:
        """Give up what `set_up` made; topics, services and timers go by themselves."""

    def starts_active(self) -> bool:
        """Return True where a node that starts by itself is active at once."""
        return True

    def autostart(self) -> None:
        """Configure and activate, where the parameter ``autostart`` says so. Raises ParameterError."""
        if not self.config.autostart:
            self.get_logger().info("unconfigured: autostart is false")
            return
        if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
            if self._refusal is not None:
                raise self._refusal
        elif self.starts_active():
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set up; a parameter that does not allow it leaves the node unconfigured."""
        done = self._transition(self.set_up)
        if done == TransitionCallbackReturn.SUCCESS:
            self.configured = True
            self.event("configured")
        return done

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin, and put it on the run's record."""
        self.active = True
        self.event("activated")
        return self._transition(self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hold, and put it on the run's record."""
        self.active = False
        self.event("deactivated")
        return self._transition(self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give up everything but the parameters."""
        self.configured = False
        return self._transition(self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node's process in order, as SIGINT does."""
        if self.exit_code is None:
            self.stopping()
            self.exit_code = 0
        return TransitionCallbackReturn.SUCCESS

    def _on_change_state(self, request: Any, response: Any) -> Any:
        """Refuse a transition that the present state does not have; rclpy would raise and end the node."""
        try:
            response = self._change_state(request, response)
        except RCLError as error:
            self.get_logger().warning(f"transition refused: {' '.join(str(error).split())}")
            response.success = False
        if self._refusal is not None:
            self.get_logger().error(str(self._refusal))
            self._refusal = None
        return response

    def _transition(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            action()
        except ParameterError as error:
            self._refusal = error
            return TransitionCallbackReturn.FAILURE
        except Exception:  # rclpy would swallow it
            self.get_logger().fatal(traceback.format_exc())
            self.exit_code = EXIT_FAILED
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _entities(self) -> list[Any]:
        return [*self.publishers, *self.subscriptions, *self.services, *self.timers]

    def _clean_up(self) -> None:
        self.tear_down()
        self.counters.clear()
        made: list[tuple[list[Any], Callable[[Any], bool]]] = [
            (list(self.timers), self.destroy_timer),
            (list(self.services), self.destroy_service),
            (list(self.subscriptions), self.destroy_subscription),
            (list(self.publishers), self.destroy_publisher),
        ]
        for entities, destroy in made:
            for entity in entities:
                if id(entity) not in self._permanent:
                    destroy(entity)

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call back periodically by the steady clock: simulated time must not drive what makes it."""
        return self.create_timer(period_s, callback, clock=self._steady_clock)

    @property
    def config(self) -> Config:
        """The active configuration: always what the stored parameters say."""
        return self._parameters_set.config

    def _on_parameters(self, old: Config, new: Config) -> None:
        before, after = values_of(old), values_of(new)
        changed = {name: value for name, value in after.items() if value != before[name]}
        self.retune(new)
        if changed:
            self._parameters_topic.publish(self._parameters_set.event(self.run_stamp_ns, changed))

    def retune(self, config: Config) -> None:
        """Take a changed configuration; called between two callbacks."""

    def diagnostics(self) -> Mapping[str, object]:
        """Return what /diagnostics says of this node, beside its counters."""
        return {}

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[[Any], None],
        qos_profile: Any,
        **more: Any,
    ) -> Subscription:
        """Create a subscription that counts publishers whose messages it will never get."""

        def incompatible(event: QoSRequestedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self.counters[f"publishers of {topic} refused for their {policy}"] += (
                event.total_count_change
            )
            self.get_logger().warning(
                f"a publisher of {topic} is not heard: its {policy} is not what this node asks for"
            )

        more.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(incompatible_qos=incompatible)
        )
        return super().create_subscription(msg_type, topic, callback, qos_profile, **more)

    def event(self, message: str, level: bytes = DiagnosticStatus.OK, **values: object) -> None:
        """Put an event on the run's record."""
        self._events_topic.publish(
            status_to_ros(
                self.run_stamp_ns, self.get_fully_qualified_name(), message, values, level
            )
        )

    def fail(self, reason: str, **values: object) -> None:
        """End this node's process with an error that the record and the console name."""
        self.get_logger().error(reason)
        self.event("failed", DiagnosticStatus.ERROR, reason=reason, **values)
        self.exit_code = EXIT_FAILED

    def stopping(self) -> None:
        """Say what is to be said when the process is told to end; called once."""

    def draining(self) -> bool:
        """Return True while the node still has something to take in before it closes."""
        return False

    def _publish_diagnostics(self) -> None:
        state = "active" if self.active else "inactive" if self.configured else "unconfigured"
        values = {"lifecycle": state, **self.diagnostics(), **self.counters}
        level = DiagnosticStatus.WARN if self.counters else DiagnosticStatus.OK
        message = ", ".join(f"{name} {count}" for name, count in self.counters.items()) or "ok"
        self._diagnostics_topic.publish(
            status_to_ros(
                self.get_clock().now().nanoseconds,
                self.get_fully_qualified_name(),
                message,
                values,
                level,
            )
        )

    def close(self) -> None:
        """Wait, within a bound, until every reliable reader has what was published; then destroy."""
        deadline = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in list(self.publishers):
            left = max(deadline - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(seconds=left))
        self.destroy_node()


class Shutdown:
    """SIGINT and SIGTERM, turned into a flag: nodes end between two callbacks, never inside one."""

    def __init__(self) -> None:
        self.requested = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._request)

    def _request(self, number: int, frame: FrameType | None) -> None:
        self.requested = True


def run_nodes(creators: Mapping[str, Callable[[], TrunkNode[Any]]], program: str) -> int:
    """Run nodes in one executor until one of them is done, or they are told to stop.

    Return the process's exit code: 0 after SIGINT, SIGTERM or a finished run; 1 where a node failed; 2,
    with one line on stderr and no traceback, where a parameter or an argument is wrong. The nodes are
    closed in the reverse order of the mapping: the recorder stands first.
    """
    shutdown = Shutdown()
    middleware.prepare()
    # rcl would say in words of its own what our one line says.
    set_logger_level("rcl", LoggingSeverity.FATAL)
    try:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    except (
        RuntimeError,
        ValueError,
    ) as error:  # RCLError and kin: a bad --ros-args argument or file
        return _usage_error(program, str(error))
    nodes: list[TrunkNode[Any]] = []
    try:
        for name, create in creators.items():
            program = name
            nodes.append(create())
            nodes[-1].autostart()
    except ParameterError as error:
        for node in reversed(nodes):
            node.close()
        rclpy.try_shutdown()
        return _usage_error(program, str(error))
    executor = LoopExecutor(linger_s=min(node.linger_s for node in nodes))
    for node in nodes:
        executor.add_node(node)
    try:
        while not shutdown.requested and all(node.exit_code is None for node in nodes):
            executor.spin_once(timeout_sec=0.1)
    except ExternalShutdownException:
        pass
    _end(nodes, executor)
    return max(node.exit_code or 0 for node in nodes)


def _end(nodes: list[TrunkNode[Any]], executor: LoopExecutor) -> None:
    for node in reversed(nodes):
        if node.exit_code is None:
            node.stopping()
    deadline = time.monotonic() + _DRAIN_S
    while any(node.draining() for node in nodes) and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.02)
    executor.shutdown()
    for node in reversed(nodes):
        node.close()
    rclpy.try_shutdown()


def _usage_error(name: str, text: str) -> int:
    line = " ".join(text.split())
    print(f"{name}: error: {line}", file=sys.stderr, flush=True)
    return EXIT_USAGE


def main_for(create: Callable[[], TrunkNode[Config]], name: str) -> Callable[[], None]:
    """Return the ``main`` of a node's executable."""

    def main() -> None:
        sys.exit(run_nodes({name: create}, name))

    return main
