"""The participants as a node sees them: from the graph, and from their events."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.topic_endpoint_info import TopicEndpointInfo

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node import discovery, qos
from trunk_msgs_util.node.adaptive import AdaptiveSubscription
from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.strangers import Sender, Senders, misfits
from trunk_msgs_util.source import process_of
from trunk_msgs_util.text import printable

from .config import SimulatorConfig
from .participants import Participants

# What a participant must be known to subscribe to; a recorder subscribes to the events last.
_HEARD = {
    topics.EFFORT_COMMAND: topics.JOINT_STATES,
    topics.DISTURBANCE: topics.GROUND_TRUTH,
    topics.REFERENCE: topics.GROUND_TRUTH,
    "recorder": topics.RUN_EVENTS,
}

# A stranger has discovered the recorder's subscription for so long after the simulator has; and the start
# waits for this no longer than that.
_HEARD_S, _UNHEARD_S = 0.5, 5.0


class GraphParticipants(Participants):
    """Asks the graph on behalf of a node, and listens to ``run/events``."""

    def __init__(
        self,
        node: TrunkNode[Any],
        config: SimulatorConfig,
        answers: Mapping[str, AdaptiveSubscription],
    ) -> None:
        """Take the node's subscriptions to the answers, by relative topic."""
        super().__init__(
            config, self._answering_count, self._command_givers, self._reporting, self._hearing
        )
        self._node = node
        self._answers = answers
        self._strangers: dict[str, Sender] = {}  # who publish commands, by GUID
        self._misfits: set[str] = set()
        self._senders_seen = -1
        self._strange_since_s: float | None = None  # monotonic clock
        self._heard_since_s = -math.inf
        self._senders = Senders(
            node, node.resolve_topic_name(topics.EFFORT_COMMAND), topics.JOINT_STATE_TYPE
        )
        node.create_subscription(
            DiagnosticArray, topics.RUN_EVENTS, self._on_event, qos.run_information()
        )

    def missing(self, now: float) -> list[str]:
        """Return the topics that the run waits for: no participant yet, or not matched both ways."""
        return super().missing(now) or self._not_met()

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

    def unsettled(self, now: float) -> bool:
        """Return True while more is to be known of who gives commands, for a bounded time; ``now`` in s."""
        return super().unsettled(now) or self._unrecorded(now)

    def _unrecorded(self, now: float) -> bool:
        """Return True while the recorder is not known to hear a stranger's commands.

        It subscribes once it has discovered the stranger, who then has to discover the subscription.
        """
        if "recorder" not in self._config.wait_for or not self.strange_senders():
            return False
        self._strange_since_s = now if self._strange_since_s is None else self._strange_since_s
        recorders = set(discovery.names(self._answering("recorder")))
        if not recorders <= discovery.listeners(self._node, topics.EFFORT_COMMAND):
            self._heard_since_s = now
        return now - self._heard_since_s < _HEARD_S and now - self._strange_since_s < _UNHEARD_S

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
        """Record which nodes of somebody else's publish commands, or no longer do, and what does not fit."""
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
