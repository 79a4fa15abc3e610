"""What all nodes of the project share: parameters, run events, diagnostics, lifecycle and shutdown."""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.utilities import get_rmw_implementation_identifier

from trunk_core import topics
from trunk_core.deadline import patience
from trunk_core.errors import EXIT_FAILED, TrunkError
from trunk_core.parameters.declarations import ParameterError, declarations, values_of
from trunk_core.parameters.shared import ManagedConfig
from trunk_core.samples import Value
from trunk_core.text import printable
from trunk_core.topics import LEVEL_ERROR, LEVEL_OK, LEVEL_WARN, Event
from trunk_recording import schemas

from ..source import HeldError, claimed, is_older, local_pid, process_id, same_machine, source
from . import endpoints, qos
from .discovery import Wait, Waiting
from .ros_parameters import ConfigClass, NodeParameters

Config = TypeVar("Config", bound=ManagedConfig)
RCLError = rclpy_implementation.RCLError
ENDING = "this node is shutting down: requests no longer change the run"

# Of two namesakes on different machines, neither in a run, one that has been configured for this long is not
# the newcomer; multiplied by TRUNK_PATIENCE.
_SETTLED_S = 3.0
# A node that the graph shows under one's own name says within this time who it is; one that was killed says
# nothing. Multiplied by TRUNK_PATIENCE.
_SPEAKS_S = 1.0


class DuplicateNodeError(TrunkError):
    """Another process of this machine has a node of this name."""

    exit_code = EXIT_FAILED


class TrunkNode(LifecycleNode, Generic[Config]):
    """A managed node with a checked configuration that reports to the recording what happens to it.

    Parameters, run events and diagnostics exist from the beginning; a subclass implements `set_up`,
    `activate`, `deactivate` and `tear_down`, which ROS 2's transitions call, and no request can crash it.
    Entities created before `keep_permanent` is called survive a cleanup.

    ``run_stamp_ns`` is the stamp of the last state that the node processed; events and changes of
    parameters carry it. A change applies from the first state with a greater stamp on.

    ``source`` names the node and its process in everything of it that is recorded; in lock-step it is empty,
    and so it is while a node does not know that it is in real time.

    Of two nodes of one name in a namespace and domain the older one stays: a recording would mix them.
    """

    def __init__(self, name: str, config_class: ConfigClass[Config]) -> None:
        """Declare and check the parameters. Raises ParameterError and DuplicateNodeError."""
        super().__init__(name, start_parameter_services=False)  # they are made with the parameters
        self.kind = name  # the node's own name may be remapped
        self.configured = False
        self.active = False
        self.counters: Counter[str] = Counter()
        self.exit_code: int | None = None  # once set, the node is done and its process ends
        # Why the run that this node was to see through has not reached its end; its process then fails.
        self.unfinished = ""
        self._told_to_end = False
        self._refusal: ParameterError | None = None
        self._permanent: set[int] = set()
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        self.run_stamp_ns = -1  # before the first state
        self._born_s = time.monotonic()
        self._replayable: list[endpoints.ReplayablePublisher] = []
        self._accounted = False
        self._configured_s = time.monotonic()
        self._doubled_since_s: float | None = None
        self._duplicate_seen = False
        self._refused: set[str] = set()  # kinds of messages
        self._waiting = Waiting()
        self._waits_for = Wait()
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._last_turns = 2
        self.linger_s = 0.0  # how long messages may collect before they are taken
        self._parameters_set = NodeParameters(
            self, config_class, self._on_parameters, lambda: ENDING if self.ending else ""
        )
        self._claim_name()  # before anything is published
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

    def _claim_name(self) -> None:
        """Hold the name against later processes of this machine. Raises DuplicateNodeError if one has it.

        Those are not told by events: what a newcomer publishes until it hears of the older node would
        already be in the run. Only processes that hear one another compete: of one domain and middleware.
        """
        name = self.get_fully_qualified_name()
        heard = f"{get_rmw_implementation_identifier()} {self.context.get_domain_id()}"
        try:
            self._claim = claimed(f"node {heard} {name}")
        except HeldError as error:
            self.destroy_node()
            raise DuplicateNodeError(_reason(name, str(error))) from None
        self._processes = {name: process_id()}  # of nodes by name: the oldest that is alive

    def destroy_node(self) -> None:
        """Destroy all of the node: rclpy leaves its state machine, and with it DDS's shared memory."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def keep_permanent(self) -> None:
        """Keep the present topics, services and timers for as long as the node exists."""
        self._permanent = {id(entity) for entity in self._entities()}

    @property
    def ending(self) -> bool:
        """True once the last messages are published: a request that comes now is refused."""
        return self._told_to_end or self.exit_code is not None

    def end(self) -> None:
        """Publish the last messages, once; a node that is done has published them."""
        if not self.ending:
            self.stopping()
        self._told_to_end = True

    def stopping(self) -> None:
        """Publish the last messages before the process ends; called once."""

    def set_up(self) -> None:
        """Create topics, services and files: from unconfigured to inactive. Raises ParameterError."""

    def activate(self) -> None:
        """Start or resume."""

    def deactivate(self) -> None:
        """Hold and keep everything."""

    def tear_down(self) -> None:
        """Release what `set_up` created; topics, services and timers are destroyed automatically."""

    def starts_active(self) -> bool:
        """Return True if a node that starts by itself is active at once."""
        return True

    @property
    def leads_a_run(self) -> bool:
        """True while a run of this node's own is under way."""
        return False

    def autostart(self) -> None:
        """Configure and activate if the parameter ``autostart`` says so. Raises ParameterError."""
        if not self.config.autostart:
            self.event(Event.UNCONFIGURED)  # its parameters are on record: so is what became of it
            self.get_logger().info("unconfigured: autostart is false")
        elif self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
            if self._refusal is not None:
                raise self._refusal
        elif self.starts_active():
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set up and report it; if a parameter is refused, the node stays unconfigured."""
        done = self._transition(self.set_up)
        if done == TransitionCallbackReturn.SUCCESS:
            self.configured = True
            self.event(Event.CONFIGURED, process=process_id(), kind=self.kind)
        return done

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate and report it."""
        self.active = True
        self.event(Event.ACTIVATED)
        return self._transition(self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and report it."""
        self.active = False
        self.event(Event.DEACTIVATED)
        return self._transition(self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything but the parameters and report it."""
        self.configured = False
        done = self._transition(self._clean_up)
        self.event(Event.CLEANED_UP)
        return done

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node's process in order, as SIGINT does."""
        self.end()
        self.exit_code = self.exit_code or 0
        return TransitionCallbackReturn.SUCCESS

    def _on_change_state(self, request: Any, response: Any) -> Any:
        """Refuse a transition that the current state does not have; rclpy would raise and end the node.

        A node that is ending has none: its record is closed.
        """
        if self.ending:
            self.get_logger().warning(f"transition refused: {ENDING}")
            response.success = False
            return response
        try:
            response = self._change_state(request, response)
        except RCLError:
            machine, asked = self._state_machine, request.transition
            labels = {number: label for number, label, *_ in machine.transition_graph}
            self.get_logger().warning(
                f"transition refused: {printable(asked.label) or labels.get(asked.id, asked.id)}; "
                "this node is "
                f"{machine.current_state[1]}, which allows "
                f"{' or '.join(label for _, label, *_ in machine.available_transitions)}"
            )
            response.success = False
        if self._refusal is not None:
            self.get_logger().error(printable(str(self._refusal)))
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
        new = values_of(self.config) if changed is None else {}
        kinds = {name: d.kind for name, d in declarations(type(self.config)).items()}
        name = self.get_fully_qualified_name()
        self._parameters_topic.publish(
            schemas.parameter_event(stamp_ns, name, new, changed or {}, kinds, self.source)
        )

    def be_in_real_time(self, real_time: bool) -> None:
        """Name the source from now on in what is recorded, or no longer."""
        self.source = self._own_source if real_time else ""

    def reconfigure(self, config: Config) -> None:
        """Take a changed configuration; called between two callbacks."""

    def diagnostics(self) -> Mapping[str, object]:
        """Return the values in /diagnostics besides this node's counters."""
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

    def create_replayable(self, topic: str, live: bool = True) -> endpoints.ReplayablePublisher:
        """Create a publisher of serialized JointState messages that the recorder must not miss.

        Unless they are ``live``, the recorder alone hears them.
        """
        self._replayable.append(endpoints.ReplayablePublisher(self, topic, live))
        return self._replayable[-1]

    def event(self, message: Event, level: int = LEVEL_OK, **values: object) -> None:
        """Publish a run event; the recorder records it."""
        if message == Event.CONFIGURED:
            self._configured_s = time.monotonic()
        name = self.get_fully_qualified_name()
        self._events_topic.publish(
            schemas.event(self.run_stamp_ns, name, message, values, level, self.source)
        )

    def refuse(self, kind: str, why: str) -> None:
        """Count a message that is not used, or not as it was meant, and say why: at once the first time.

        The log then has a line at the 10th, the 100th and so on; the record has the first and the count.
        """
        self.counters[kind] += 1
        count = self.counters[kind]
        if count == 1:
            self._refused.add(kind)
            self.event(Event.REFUSED, LEVEL_WARN, what=kind, why=why)
        if str(count).rstrip("0") == "1":  # a power of ten
            so_far = "" if count == 1 else f" ({count} so far)"
            self.get_logger().warning(printable(f"{kind}{so_far}: {why}"))

    def _say_refused(self) -> None:
        """Record how many messages were refused, of each kind."""
        counts = {kind: self.counters[kind] for kind in sorted(self._refused)}
        self._refused.clear()
        if counts:
            self.event(Event.REFUSED, LEVEL_WARN, **counts)

    def fail(self, reason: str, **values: object) -> None:
        """End this node's process with an error, reported in the recording and on the console."""
        self.get_logger().error(printable(reason))
        self.event(Event.FAILED, LEVEL_ERROR, reason=reason, **values)
        self.exit_code = EXIT_FAILED

    def draining(self) -> bool:
        """Return True while the node still has messages to take before it closes.

        What has arrived by then is taken, as it may be the run's last state; a failed node takes nothing.
        """
        self._last_turns -= 1
        return self._last_turns >= 0 and not self.exit_code

    def waits_for(self) -> Wait:
        """Return what is waited for, and how to start it; asked once a second."""
        return Wait()

    def _every_second(self) -> None:
        self._waits_for = self.waits_for() if self.configured and self.exit_code is None else Wait()
        self._publish_diagnostics()
        line = self._waiting.line(self._waits_for, time.monotonic())
        if line:
            self.get_logger().info(printable(line))

    def _publish_diagnostics(self) -> None:
        state = "active" if self.active else "inactive" if self.configured else "unconfigured"
        waits = {"waiting for": self._waits_for.what, "seen instead": self._waits_for.seen_instead}
        waits = {name: text for name, text in waits.items() if text}
        values = {"lifecycle": state, **waits, **self.diagnostics(), **self.counters}
        level = LEVEL_WARN if self.counters else LEVEL_OK
        message = ", ".join(f"{name} {count}" for name, count in self.counters.items()) or "ok"
        now_ns, name = self.get_clock().now().nanoseconds, self.get_fully_qualified_name()
        self._diagnostics_topic.publish(schemas.event(now_ns, name, message, values, level))

    def _clean_up(self) -> None:
        self._say_refused()
        endpoints.await_acknowledgement(self, self._born_s, self._replayable)
        self._replayable.clear()
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

    def account(self) -> None:
        """Report, once, how much evidence was published; nothing is published after it."""
        self._say_refused()
        counts = endpoints.counted(self._replayable)
        if counts and not self._accounted:
            self._accounted = True
            self.event(Event.PUBLISHED, LEVEL_OK, **counts)

    def close(self) -> None:
        """Report how much evidence was published, wait a bounded time until it is recorded, then destroy."""
        self.account()
        endpoints.await_acknowledgement(self, self._born_s, self._replayable)
        self.destroy_node()
        self._claim.close()

    # A second node of one name, on another machine: the newcomer ends as soon as it knows.

    def look_for_duplicate(self, node: str, message: str, values: Mapping[str, str]) -> None:
        """End this node if an event shows that an older one has its name.

        Of two on one machine the processes' identities tell which is older. Of others, the one whose run is
        under way stays, and so does one that has been configured for a while.
        """
        process = values.get("process", "")
        if (
            message != Event.CONFIGURED
            or node != self.get_fully_qualified_name()
            or process in ("", process_id())
            or self.exit_code is not None
            or not self._is_alive(node, process)
        ):
            return
        self._duplicate_seen = True
        first = is_older(process_id(), process)
        if first is None:
            waited = time.monotonic() - self._configured_s
            first = self.leads_a_run or waited > _SETTLED_S * patience()
        if first:
            self.get_logger().warning(
                f"a second {node} was started, in process {printable(process)}: it ends by itself"
            )
        elif self.leads_a_run:
            self.fail(_reason(node, process))
        else:  # without an event: the older node's recording would take it for that node's
            self.get_logger().error(printable(_reason(node, process)))
            self.exit_code = EXIT_FAILED

    def may_be_second(self) -> bool:
        """Return True, for a bounded time, while the graph shows another node of this name that is silent."""
        if self._duplicate_seen or not self._is_doubled(self.get_fully_qualified_name()):
            self._doubled_since_s = None
            return False
        if self._doubled_since_s is None:
            self._doubled_since_s = time.monotonic()
        return time.monotonic() - self._doubled_since_s < _SPEAKS_S * patience()

    def is_second(self, node: str, process: str) -> bool:
        """Return True for the process of a node whose name an older process that is alive has: it ends.

        A node is not a second one if its process is not known.
        """
        first = self._processes.get(node, "")
        if not process or process == first:
            return False
        if first and not is_older(process, first) and self._is_alive(node, first):
            return True
        self._processes[node] = process
        return False

    def _is_alive(self, node: str, process: str) -> bool:
        """Return True for a node's process, and False if an old recording is being played.

        A process on another machine cannot be looked up: there the graph must show two nodes of the name.
        """
        if same_machine(process):
            return local_pid(process) is not None
        return self._is_doubled(node)

    def _is_doubled(self, node: str) -> bool:
        """Return True if the graph shows more than one node of a name."""
        namespace, _, name = node.rpartition("/")
        return self.get_node_names_and_namespaces().count((name, namespace or "/")) > 1


def _reason(node: str, process: str) -> str:
    return (
        f"another {node} is running, in process {process or 'unknown'}: stop it, or give each its own "
        "namespace or ROS_DOMAIN_ID"
    )
