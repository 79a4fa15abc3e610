"""Who takes part in a run: who is ready, who is missing, and that one controller acts at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.topic_endpoint_info import TopicEndpointInfo

from trunk_core import topics
from trunk_core.text import printable
from trunk_core.topics import Event
from trunk_msgs_util.node import discovery, qos
from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.endpoints import AdaptiveSubscription
from trunk_msgs_util.node.strangers import Sender, Senders, misfits
from trunk_msgs_util.source import process_of

from .config import SimulatorConfig

# A participant that sends no events (another project's controller) counts as ready once it has been matched
# for this long; or for this long where it is not known to hear the states: `ros2 topic pub` never does, but
# on a bad link a node's events and subscriptions may be discovered much later than its commands.
_MATCHED_S, _DEAF_S = 1.0, 10.0
# DDS discovers a publisher first, then its node, then that node's events: after `strangers.UNNAMED_S` it is
# known whether there is one.
_STRANGER_S = 4.0
# What a participant must be known to subscribe to; a recorder subscribes to the parameters last.
_HEARD = {
    topics.EFFORT_COMMAND: topics.JOINT_STATES,
    topics.DISTURBANCE: topics.GROUND_TRUTH,
    topics.REFERENCE: topics.GROUND_TRUTH,
    "recorder": topics.RUN_PARAMETERS,
}
# A stranger has discovered the recorder's subscription for so long after the simulator has; and the start
# waits for this no longer than that.
_HEARD_S, _UNHEARD_S = 0.5, 5.0


class Participants:
    """What the simulator knows about the other nodes, from the graph and from ``run/events``."""

    def __init__(
        self,
        node: TrunkNode[Any],
        config: SimulatorConfig,
        answers: Mapping[str, AdaptiveSubscription],
    ) -> None:
        """Take the node's subscriptions to the answers, by relative topic."""
        self._node = node
        self._config = config
        self._answers = answers
        self._heard: set[str] = set()  # nodes of which an event has arrived
        self._ready: dict[str, set[str]] = {}  # topic -> nodes that answer on it
        self._configured: set[str] = set()  # nodes that report about themselves
        self._inactive: set[str] = set()
        self._unready: set[str] = set()  # were ready once but have reopened their topics since
        self._matched_since: dict[str, float] = {}
        self._met: set[str] = set()  # topics whose publishers were matched
        self._unnamed_since: float | None = None
        self._strangers: dict[str, Sender] = {}  # who publish commands, by GUID
        self._misfits: set[str] = set()
        self._senders_seen = -1
        self._strange_since: float | None = None
        self._heard_since = -math.inf
        self._senders = Senders(
            node, node.resolve_topic_name(topics.EFFORT_COMMAND), topics.JOINT_STATE_TYPE
        )
        node.create_subscription(
            DiagnosticArray, topics.RUN_EVENTS, self._on_event, qos.run_information()
        )

    def hear(self, node: str, message: str, values: Mapping[str, str]) -> None:
        """Process a node's event on ``run/events``."""
        self._heard.add(node)
        if message == Event.CONFIGURED:
            self._configured.add(node)
        if message == Event.READY and "answers" in values:
            self._ready.setdefault(values["answers"], set()).add(node)
            self._unready.discard(node)
        elif message == Event.ACTIVATED:
            self._inactive.discard(node)
        elif message in (Event.CONFIGURED, Event.DEACTIVATED, Event.CLEANED_UP):
            self._inactive.add(node)
            if message != Event.DEACTIVATED:
                self._unready.add(node)

    def missing(self, now: float) -> list[str]:
        """Return the topics, and the controllers, without which the run cannot begin; ``now`` in s.

        Those that are there but not matched both ways count once nothing else is missing.
        """
        missing = []
        for name in self._config.wait_for:
            if self._answering_count(name):
                waited = now - self._matched_since.setdefault(name, now)
            else:
                self._matched_since.pop(name, None)
                waited = 0.0
            if not self._may_answer(name, waited):
                missing.append(name)
        ready = {name.rsplit("/", 1)[-1] for name in self._ready_on(topics.EFFORT_COMMAND)}
        missing += [name for name in self._config.controllers if name not in ready]
        return missing or self._not_met()

    def _may_answer(self, topic: str, waited: float) -> bool:
        """Return True if a node is ready on a topic that has been matched for ``waited`` s."""
        ready = self._ready_on(topic)
        # A node that was deactivated since must be activated again, unless it takes turns.
        turns = {name for name in ready if name.rsplit("/", 1)[-1] in self._config.controllers}
        if ready - self._inactive or turns:
            return True
        if self._reporting(topic) - self._heard:
            return False  # its events are under way, on a busy machine for longer
        if topic == topics.EFFORT_COMMAND:
            ready = set(self._command_givers())
        needed = _MATCHED_S if self._hearing(topic) else _DEAF_S
        return waited >= needed and not (ready and ready <= self._inactive)

    def unmet(self, topic: str, matched: int, publishing: Set[str], listening: Set[str]) -> bool:
        """Return True if a node that is ready on a topic is not yet known to subscribe to what it answers.

        Its event may arrive before its publisher has a name, or before it is matched at all. If one was
        ``matched`` before and none is now, there is nothing left to wait for.
        """
        if matched:
            self._met.add(topic)
        elif topic in self._met:
            return False
        ready = self._ready_on(topic)
        here = ready & publishing
        return bool(ready) and not (here and here <= listening)

    def _ready_on(self, topic: str) -> set[str]:
        return self._ready.get(topic, set()) - self._unready

    def unsettled(self, now: float) -> bool:
        """Return True while more is to be known of who gives commands, for a bounded time; ``now`` in s."""
        names = self._command_givers()
        if not _unnamed(names) and len(self._acting(names)) <= 1:
            self._unnamed_since = None
            return self._unrecorded(now)
        if self._unnamed_since is None:
            self._unnamed_since = now
        return now - self._unnamed_since < _STRANGER_S or self._unrecorded(now)

    def rivals(self) -> list[str]:
        """Return the nodes that act although only one may; none while one of them has no name yet."""
        names = self._command_givers()
        acting = self._acting(names)
        return [] if _unnamed(names) or len(acting) <= 1 else acting

    def strangers(self) -> list[str]:
        """Return the publishers of commands that report nothing about themselves."""
        return [name for name in self._command_givers() if name not in self._configured]

    def idle(self) -> list[str]:
        """Return the controllers that are ready but inactive; none where one of them acts."""
        ready = self._ready_on(topics.EFFORT_COMMAND)
        return sorted(ready) if ready <= self._inactive else []

    def acting(self) -> list[str]:
        """Return the active publishers of commands; those that take turns count as one."""
        return self._acting(self._command_givers())

    def _acting(self, names: Sequence[str]) -> list[str]:
        """Like `acting`, for names read once: discovery goes on, and a second read may differ."""
        turns = self._config.controllers
        seen: set[str] = set()
        acting: list[str] = []
        for name in sorted(names):
            own = name.rsplit("/", 1)[-1]
            if name in self._inactive:
                continue
            if own not in turns or own in seen or not seen:
                acting.append(name)
            if own in turns:
                seen.add(own)
        return acting

    def describe(self, topic: str) -> str:
        """Return who answers on a topic, as text for a message."""
        ready = self._ready.get(topic, set())
        answering = ready - self._inactive
        strangers = self.strangers() if topic == topics.EFFORT_COMMAND and not ready else []
        names = " or ".join(sorted(answering or ready) or strangers) or "anyone"
        return f"{names} ({topic}{'; inactive' if ready and not answering else ''})"

    def _not_met(self) -> list[str]:
        """Return the topics with a ready node that is not matched both ways: it would miss state 0.

        A short run might not wait to hand its evidence over to a recorder that is not known by then.
        """
        return [
            topic
            for topic, heard in _HEARD.items()
            if self.unmet(
                topic,
                self._answering_count(topic),
                discovery.known(self._answering(topic)),
                discovery.listeners(self._node, heard),
            )
        ]

    def _unrecorded(self, now: float) -> bool:
        """Return True while the recorder is not known to hear a stranger's commands.

        It subscribes once it has discovered the stranger, who then has to discover the subscription.
        """
        if "recorder" not in self._config.wait_for or not self.strange_senders():
            return False
        self._strange_since = now if self._strange_since is None else self._strange_since
        recorders = set(discovery.names(self._answering("recorder")))
        if not recorders <= discovery.listeners(self._node, topics.EFFORT_COMMAND):
            self._heard_since = now
        return now - self._heard_since < _HEARD_S and now - self._strange_since < _UNHEARD_S

    def _answering(self, topic: str) -> list[TopicEndpointInfo]:
        """Return the endpoints of those who answer on a topic; a recorder subscribes to the evidence."""
        if topic == "recorder":
            states = self._node.resolve_topic_name(topics.GROUND_TRUTH)
            return discovery.recorders(self._node, states)
        return self._node.get_publishers_info_by_topic(topic)

    def _answering_count(self, topic: str) -> int:
        """Return how many of them are matched with this node."""
        if topic == "recorder":
            return len(self._answering(topic))
        subscription = self._answers.get(topic)
        return 0 if subscription is None else subscription.get_publisher_count()

    def _command_givers(self) -> list[str]:
        return [sender.label for sender in self._senders.look()]

    def strange_senders(self) -> list[Sender]:
        """Return who publishes commands and is no node of ours; without those whose name may still come."""
        ours = self._reporting(topics.EFFORT_COMMAND)
        return [
            sender
            for sender in self._senders.look()
            if sender.label in self.strangers()
            and sender.name not in ours
            and not sender.name.endswith(topics.UNKNOWN_NODE)
        ]

    def look_for_strangers(self) -> None:
        """Record which external nodes publish commands, or no longer do, and what does not fit."""
        commands = self._answers[topics.EFFORT_COMMAND]
        states = self._node.resolve_topic_name(topics.JOINT_STATES)
        for why in misfits(self._node, commands.topic_name, states, topics.JOINT_STATE_TYPE):
            if why not in self._misfits:
                self._misfits.add(why)
                self._node.refuse("endpoints whose quality of service does not fit", why)
        count = commands.get_publisher_count()
        if count == self._senders_seen:
            return
        self._senders_seen = count
        now = {sender.guid: sender for sender in self.strange_senders()}
        before, self._strangers = self._strangers, now
        log, topic = self._node.get_logger(), commands.topic_name
        for sender in (now[guid] for guid in now.keys() - before.keys()):
            log.info(printable(f"{sender.label} publishes {topic}"))
            self._node.event(Event.CONNECTED, node=sender.name, middleware=sender.middleware)
        for sender in (before[guid] for guid in before.keys() - now.keys()):
            log.info(printable(f"{sender.label} is gone from {topic}"))
            self._node.event(Event.DISCONNECTED, node=sender.name, middleware=sender.middleware)

    def _reporting(self, topic: str) -> set[str]:
        return discovery.reporting(self._node, self._answering(topic))

    def _hearing(self, topic: str) -> bool:
        listeners = self._node.get_subscriptions_info_by_topic(_HEARD[topic])
        return discovery.share_a_participant(self._answering(topic), listeners)

    def _on_event(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            process = process_of(message.header.frame_id) or values.get("process", "")
            if not self._node.is_second(status.name, process):
                self.hear(status.name, status.message, values)
            self._node.look_for_duplicate(status.name, status.message, values)


def _unnamed(names: Sequence[str]) -> bool:
    """Return True if a publisher of commands is discovered but its node is not."""
    return any(name.endswith(topics.UNKNOWN_NODE) for name in names)
