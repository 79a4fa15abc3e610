"""A single-threaded executor that is quick for the messages of a control loop.

rclpy's own executor collects all entities and builds a new wait set for each callback, which costs more
than the callback itself. This one takes messages and calls timers directly, waits on a set that it builds
once, and leaves everything else (services, guard conditions, events of the middleware) to rclpy, so that it
behaves as usual. A node has dozens of these, and each makes a wait longer: for some time after a message it
waits without them.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities

# While messages keep coming, this is how often timers get their turn, and services and everything else.
_TIMERS_EVERY_NS = 2_000_000
_OTHERS_EVERY_NS = 20_000_000
# Messages taken from one subscription before the next one's turn.
_BURST = 64
# A subscription without a message this many times in a row (events, references) is polled only once in as
# many turns while other messages keep coming. A wait covers all subscriptions.
_RARE = 16


class LoopExecutor(SingleThreadedExecutor):
    """Runs callbacks in the thread that calls ``spin_once``; messages first, in their order per topic."""

    def __init__(self, linger_s: Callable[[], float] = lambda: 0.0, **arguments: Any) -> None:
        """Create it; ``linger_s`` says how long, in s, messages collect before they are taken."""
        super().__init__(**arguments)
        self._linger_s = linger_s
        self._subscriptions: list[Subscription] = []
        self._with_info: list[bool] = []
        self._in_vain: list[int] = []  # turns without a message
        self._turn = 0
        self._timers: list[Timer] = []
        self._wait_set: Any = None
        self._known = -1
        self._timers_due_ns = 0
        self._others_due_ns = 0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Handle what is ready, or wait for it for at most ``timeout_sec`` s (None: forever)."""
        if self._wait_set is None:
            self._collect()
        self._turn += 1
        taken = self._take_messages(rare_ones=self._turn % _RARE == 0)
        now_ns = time.monotonic_ns()
        if now_ns >= self._timers_due_ns:
            self._call_timers()
        if taken:
            if now_ns >= self._others_due_ns:
                self._others()
            return
        left_ns = self._others_due_ns - now_ns
        for_all = left_ns <= 0
        limit_ns = -1 if timeout_sec is None else round(timeout_sec * 1e9)
        if not for_all and not 0 <= limit_ns < left_ns:
            limit_ns = left_ns
        others = self._wait(limit_ns, for_all)
        if for_all and not others:
            self._others_due_ns = time.monotonic_ns() + _OTHERS_EVERY_NS
        self._take_messages(rare_ones=True)
        self._call_timers()
        if others:
            self._others()
            self._others_due_ns = 0  # one was handled: there may be more

    def _others(self) -> None:
        super().spin_once(0.0)
        self._collect()
        self._others_due_ns = time.monotonic_ns() + _OTHERS_EVERY_NS

    def _collect(self) -> None:
        """Look up the nodes' entities again if any was created or destroyed."""
        nodes = self.get_nodes()
        subscriptions = [s for node in nodes for s in node.subscriptions]
        timers = [t for node in nodes for t in node.timers]
        services = [s for node in nodes for s in node.services]
        guards = [*(g for node in nodes for g in node.guards), self._guard]
        waitables = [w for node in nodes for w in node.waitables]
        entities = (*subscriptions, *timers, *services, *guards, *waitables)
        known = hash(tuple(id(e) for e in entities))
        if known == self._known:
            return
        self._known = known
        self._cb_iter = None  # rclpy would go on by places in an outdated wait set
        self._subscriptions = subscriptions
        self._with_info = [wants_info(s.callback) for s in subscriptions]
        self._in_vain = [0] * len(subscriptions)
        self._timers, self._services, self._guards = timers, services, guards
        self._waitables = waitables
        count = sum(
            (waitable.get_num_entities() for waitable in waitables),
            NumberOfEntities(len(subscriptions), len(guards), len(timers), 0, len(services)),
        )
        self._wait_set = _rclpy.WaitSet(
            count.num_subscriptions,
            count.num_guard_conditions,
            count.num_timers,
            count.num_clients,
            count.num_services,
            count.num_events,
            self._context.handle,
        )

    def _take_messages(self, rare_ones: bool) -> bool:
        taken = False
        in_vain = self._in_vain
        for i, subscription in enumerate(self._subscriptions):
            if in_vain[i] > _RARE and not rare_ones:
                continue
            handle, callback = subscription.handle, subscription.callback
            with_info = self._with_info[i]
            in_vain[i] += 1
            for _ in range(_BURST):
                message = handle.take_message(subscription.msg_type, subscription.raw)
                if message is None:
                    break
                taken, in_vain[i] = True, 0
                if with_info:
                    callback(*message)
                else:
                    callback(message[0])
        return taken

    def _call_timers(self) -> None:
        self._timers_due_ns = time.monotonic_ns() + _TIMERS_EVERY_NS
        for timer in self._timers:
            try:
                if not timer.is_ready():
                    continue
                timer.handle.call_timer()
            except InvalidHandle:  # another callback has destroyed it
                continue
            timer.callback()

    def _fill_wait_set(self, for_all: bool) -> None:
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._subscriptions:
            wait_set.add_subscription(subscription.handle)
        for timer in self._timers:
            wait_set.add_timer(timer.handle)
        for guard in self._guards:
            wait_set.add_guard_condition(guard.handle)
        if for_all:
            for service in self._services:
                wait_set.add_service(service.handle)
            for waitable in self._waitables:
                waitable.add_to_wait_set(wait_set)

    def _wait(self, limit_ns: int, for_all: bool) -> bool:
        """Wait, including services and events only if ``for_all``; a ``limit_ns`` below 0 is no limit.

        Return True if something other than a message or a timer is ready.
        """
        try:
            self._fill_wait_set(for_all)
        except (InvalidHandle, _rclpy.RCLError):  # a callback has destroyed something
            self._collect()
            self._fill_wait_set(for_all)
        wait_set = self._wait_set
        wait_set.wait(limit_ns)
        linger_s = self._linger_s()
        if linger_s and wait_set.get_ready_entities("subscription"):
            time.sleep(linger_s)
        triggered = wait_set.get_ready_entities("guard_condition")
        for guard in self._guards:
            if guard.handle.pointer in triggered and guard is not self._guard:
                guard.trigger()  # the wait has cleared it, and rclpy is still to see it
        if triggered or wait_set.get_ready_entities("service"):
            return True
        return for_all and any(waitable.is_ready(wait_set) for waitable in self._waitables)


def wants_info(callback: Callable[..., Any]) -> bool:
    """Return True for a callback that also takes the message's information, by rclpy's own rule."""
    try:
        inspect.signature(callback).bind(object())
    except TypeError:
        return True
    return False
