"""A managed node whose transitions are four plain methods, and which no request can crash."""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from ..errors import EXIT_FAILED
from ..events import Event
from ..parameters.declarations import ParameterError
from ..source import process_id
from ..text import printable

RCLError = rclpy_implementation.RCLError
ENDING = "this node is shutting down: requests no longer change the run"


class ManagedNode(LifecycleNode):
    """ROS 2's lifecycle; a subclass implements `set_up`, `activate`, `deactivate` and `tear_down`.

    Entities created before `keep_permanent` is called survive a cleanup.
    """

    def __init__(self, name: str, **arguments: Any) -> None:
        super().__init__(name, **arguments)
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

    def destroy_node(self) -> None:
        """Destroy all of the node: rclpy leaves its state machine, and with it DDS's shared memory."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def keep_permanent(self) -> None:
        """Keep the present topics, services and timers for as long as the node exists."""
        self._permanent = {id(entity) for entity in self._entities()}

    def event(self, message: Event, level: int = 0, **values: object) -> None:
        """Put an event in the run's record."""

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

    def autostart(self) -> None:
        """Configure and activate. Raises ParameterError if a parameter does not allow it."""
        if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
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
