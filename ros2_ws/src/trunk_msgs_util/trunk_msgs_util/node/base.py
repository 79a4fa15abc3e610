"""What all nodes of the project share: parameters, run events, diagnostics, lifecycle and shutdown."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterEvent
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from .. import topics
from ..errors import EXIT_FAILED
from ..events import Event
from ..parameters.config import ManagedConfig
from ..parameters.declarations import values_of
from ..printable import printable
from ..process_id import process_id
from ..source import source
from ..values import Value
from . import evidence, qos
from .conversions import status_to_ros
from .managed import ENDING
from .namesakes import UniqueNode
from .ros_parameters import NodeParameters
from .waiting import Waiting

Config = TypeVar("Config", bound=ManagedConfig)


class TrunkNode(UniqueNode, Generic[Config]):
    """A managed node with a checked configuration that reports to the recording what happens to it.

    Parameters, run events and diagnostics exist from the beginning; a subclass implements `set_up`,
    `activate`, `deactivate` and `tear_down`, which ROS 2's transitions call.

    ``run_stamp_ns`` is the stamp of the last state that the node processed; events and changes of
    parameters carry it. A change applies from the first state with a greater stamp on.

    ``source`` names the node and its process in everything of it that is recorded; in lock-step it is empty,
    and so it is while a node does not know that it is in real time.
    """

    def __init__(self, name: str, config_class: type[Config]) -> None:
        """Declare and check the parameters. Raises ParameterError, and NamesakeError if the name is taken."""
        super().__init__(name, start_parameter_services=False)  # they are made with the parameters
        self.run_stamp_ns = -1  # before the first state
        self._born_s = time.monotonic()
        self._evidence: list[evidence.Evidence] = []
        self._accounted = False
        self._refused: set[str] = set()  # kinds of messages
        self._waiting = Waiting()
        self._waits_for = ""
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._last_turns = 2
        self.linger_s = 0.0  # how long messages may collect before they are taken
        self._parameters_set = NodeParameters(
            self, config_class, self._on_parameters, lambda: ENDING if self.ending else ""
        )
        self.claim_name()  # before anything is published
        self._parameters_topic = self.create_publisher(
            ParameterEvent, topics.RUN_PARAMETERS, qos.run_information()
        )
        self._events_topic = self.create_publisher(
            DiagnosticArray, topics.RUN_EVENTS, qos.run_information()
        )
        self._diagnostics_topic = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._own_source = source(self.get_name(), process_id())
        self.source = ""
        # The disturbance has no such parameter: it knows from the states that it receives.
        self.be_in_real_time(not getattr(self.config, "lockstep", True))
        self._say_parameters(0)
        self._diagnostics_timer = self.every(1.0, self._every_second)
        self.keep_permanent()

    def autostart(self) -> None:
        """Configure and activate if the parameter ``autostart`` says so. Raises ParameterError."""
        if self.config.autostart:
            super().autostart()
        else:
            self.get_logger().info("unconfigured: autostart is false")

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call back periodically by the steady clock: simulated time must not drive its own source."""
        return self.create_timer(period_s, callback, clock=self._steady_clock)

    @property
    def config(self) -> Config:
        """The active configuration, always equal to the stored parameters."""
        return self._parameters_set.config

    def _on_parameters(self, old: Config, new: Config) -> None:
        before, after = values_of(old), values_of(new)
        changed = {name: value for name, value in after.items() if value != before[name]}
        self.reconfigure(new)
        if changed:
            # There is no order between two topics: this marks the change's place among the node's events.
            self.event(Event.RETUNED)
            self._say_parameters(self.run_stamp_ns, changed)

    def _say_parameters(self, stamp_ns: int, changed: Mapping[str, Value] | None = None) -> None:
        message = self._parameters_set.event(stamp_ns, changed, self.source)
        self._parameters_topic.publish(message)

    def be_in_real_time(self, real_time: bool) -> None:
        """Name the source from now on in what is recorded, or no longer."""
        self.source = self._own_source if real_time else ""

    def reconfigure(self, config: Config) -> None:
        """Take a changed configuration; called between two callbacks."""

    def diagnostics(self) -> Mapping[str, object]:
        """Return what /diagnostics reports on this node besides its counters."""
        return {}

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., None],
        qos_profile: Any,
        **more: Any,
    ) -> Subscription:
        """Create a subscription that counts publishers whose quality of service is incompatible."""

        def incompatible(event: QoSRequestedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self.counters[f"publishers of {topic} refused for their {policy}"] += (
                event.total_count_change
            )
            self.get_logger().warning(
                f"a publisher of {topic} is ignored: its {policy} is incompatible with this node's"
            )

        more.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(incompatible_qos=incompatible)
        )
        return super().create_subscription(msg_type, topic, callback, qos_profile, **more)

    def create_evidence(self, topic: str, live: bool = True) -> evidence.Evidence:
        """Create a publisher of serialized JointState messages that the recorder must not miss.

        Unless they are ``live``, the recorder alone hears them.
        """
        self._evidence.append(evidence.Evidence(self, topic, live))
        return self._evidence[-1]

    def event(self, message: Event, level: bytes = DiagnosticStatus.OK, **values: object) -> None:
        """Publish a run event; the recorder records it."""
        super().event(message, level, **values)
        self._events_topic.publish(
            status_to_ros(
                self.run_stamp_ns,
                self.get_fully_qualified_name(),
                message,
                values,
                level,
                self.source,
            )
        )

    def refuse(self, what: str, why: str) -> None:
        """Count a message that is not used, or not as it was meant, and say why: at once the first time.

        The log then has a line at the 10th, the 100th and so on; the record has the first and the count.
        """
        self.counters[what] += 1
        count = self.counters[what]
        if count == 1:
            self._refused.add(what)
            self.event(Event.REFUSED, DiagnosticStatus.WARN, what=what, why=why)
        if str(count).rstrip("0") == "1":  # a power of ten
            so_far = "" if count == 1 else f" ({count} so far)"
            self.get_logger().warning(printable(f"{what}{so_far}: {why}"))

    def _say_refused(self) -> None:
        """Record how many messages were refused, of each kind."""
        counts = {what: self.counters[what] for what in sorted(self._refused)}
        self._refused.clear()
        if counts:
            self.event(Event.REFUSED, DiagnosticStatus.WARN, **counts)

    def fail(self, reason: str, **values: object) -> None:
        """End this node's process with an error, reported in the recording and on the console."""
        self.get_logger().error(printable(reason))
        self.event(Event.FAILED, DiagnosticStatus.ERROR, reason=reason, **values)
        self.exit_code = EXIT_FAILED

    def draining(self) -> bool:
        """Return True while the node still has messages to take before it closes.

        What has arrived by then is taken, as it may be the run's last state; a failed node takes nothing.
        """
        self._last_turns -= 1
        return self._last_turns >= 0 and not self.exit_code

    def waits_for(self) -> str:
        """Return what this node waits for, and how to start it; called once a second. Empty: for nothing."""
        return ""

    def _every_second(self) -> None:
        self._waits_for = self.waits_for() if self.configured and self.exit_code is None else ""
        self._publish_diagnostics()
        line = self._waiting.line(self._waits_for, time.monotonic())
        if line:
            self.get_logger().info(printable(line))

    def _publish_diagnostics(self) -> None:
        state = "active" if self.active else "inactive" if self.configured else "unconfigured"
        waits = {"waiting for": self._waits_for} if self._waits_for else {}
        values = {"lifecycle": state, **waits, **self.diagnostics(), **self.counters}
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

    def _clean_up(self) -> None:
        self._say_refused()
        evidence.hand_over(self, self._born_s, self._evidence)
        self._evidence.clear()
        super()._clean_up()

    def account(self) -> None:
        """Report, once, how much evidence was published; nothing is published after it."""
        self._say_refused()
        counts = evidence.counted(self._evidence)
        if counts and not self._accounted:
            self._accounted = True
            self.event(Event.PUBLISHED, DiagnosticStatus.OK, **counts)

    def close(self) -> None:
        """Report how much evidence was published, wait a bounded time until it is recorded, then destroy."""
        self.account()
        evidence.hand_over(self, self._born_s, self._evidence)
        self.destroy_node()
        self.release_name()
