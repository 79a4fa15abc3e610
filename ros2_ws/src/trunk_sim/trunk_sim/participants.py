"""Who takes part in a run: who is ready, who is missing, and that one controller acts at a time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.subscription import Subscription

from trunk_msgs_util import topics

from .config import SimulatorConfig

# A participant that says nothing of itself (another project's controller) is taken as ready when it has
# been matched for this long.
_MATCHED_S = 1.0
# A node is discovered after its publisher, and what it says of itself after that.
_STRANGER_S = 3.0


class Participants:
    """What the simulator knows of the others, from the graph and from what they say on ``run/events``."""

    def __init__(
        self, node: Node, config: SimulatorConfig, subscriptions: Mapping[str, Subscription]
    ) -> None:
        """``subscriptions``: those on the topics whose publishers are awaited."""
        self._node = node
        self._config = config
        self._subscriptions = subscriptions
        self._ready: dict[str, set[str]] = {}  # topic -> nodes that answer on it
        self._inactive: set[str] = set()
        self._matched_since: dict[str, float] = {}
        self._strange_since: float | None = None

    def hear(self, message: DiagnosticArray) -> None:
        """Take in what the nodes say of themselves."""
        for status in message.status:
            if status.message == "ready":
                for value in status.values:
                    if value.key == "answers":
                        self._ready.setdefault(value.value, set()).add(status.name)
            elif status.message == "activated":
                self._inactive.discard(status.name)
            elif status.message in ("configured", "deactivated"):
                self._inactive.add(status.name)

    def missing(self) -> list[str]:
        """Return the topics, and the controllers, without which the run cannot begin."""
        now = time.monotonic()
        missing = []
        for name in self._config.wait_for:
            subscription = self._subscriptions.get(name)
            if subscription is None or subscription.get_publisher_count() == 0:
                self._matched_since.pop(name, None)
                waited = 0.0
            else:
                waited = now - self._matched_since.setdefault(name, now)
            if name not in self._ready and waited < _MATCHED_S:
                missing.append(name)
        ready = {name.rsplit("/", 1)[-1] for name in self._ready.get(topics.EFFORT_COMMAND, ())}
        return missing + [name for name in self._config.controllers if name not in ready]

    def unsettled(self) -> bool:
        """Return True, for a bounded time, while it is not known who is behind a publisher of commands."""
        now = time.monotonic()
        if not self.unnamed() and len(self.acting()) <= 1:
            self._strange_since = None
            return False
        if self._strange_since is None:
            self._strange_since = now
        return now - self._strange_since < _STRANGER_S

    def unnamed(self) -> bool:
        """Return True where a publisher of commands is discovered but not its node."""
        return any(p.node_name == "_NODE_NAME_UNKNOWN_" for p in self._publishers())

    def acting(self) -> list[str]:
        """Return the nodes that may act at the same time: those that take turns count as one."""
        publishing = sorted(
            f"{p.node_namespace.rstrip('/')}/{p.node_name}" for p in self._publishers()
        )
        active = [name for name in publishing if name not in self._inactive]
        turns = self._config.controllers
        seen: set[str] = set()
        acting: list[str] = []
        for name in active:
            own = name.rsplit("/", 1)[-1]
            if own not in turns or own in seen or not seen:
                acting.append(name)
            if own in turns:
                seen.add(own)
        return acting

    def _publishers(self) -> list[Any]:
        topic = self._subscriptions[topics.EFFORT_COMMAND].topic_name
        found: list[Any] = self._node.get_publishers_info_by_topic(topic)
        return found

    def describe(self, topic: str) -> str:
        """Return who answers on a topic, for people."""
        ready = self._ready.get(topic, set())
        names = sorted(ready - self._inactive or ready)
        return f"{' or '.join(names) or 'anyone'} ({topic})"
