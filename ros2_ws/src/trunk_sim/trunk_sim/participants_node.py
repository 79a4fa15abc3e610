"""The participants as a node sees them: from the graph, and from their events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.subscription import Subscription

from trunk_msgs_util import topics
from trunk_msgs_util.node import meeting, qos
from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.source import process_of

from .config import SimulatorConfig
from .participants import Participants

# What a participant publishes, and must be known to subscribe to; a recorder subscribes to the events last.
_ANSWERED = {
    topics.EFFORT_COMMAND: (topics.EFFORT_COMMAND, topics.JOINT_STATES),
    topics.DISTURBANCE: (topics.DISTURBANCE, topics.GROUND_TRUTH),
    "recorder": (topics.RECORDER_PROGRESS, topics.RUN_EVENTS),
}


class GraphParticipants(Participants):
    """Asks the graph on behalf of a node, and listens to ``run/events``."""

    def __init__(
        self, node: TrunkNode[Any], config: SimulatorConfig, answers: Mapping[str, Subscription]
    ) -> None:
        """Take the node's subscriptions to the answers, by relative topic."""
        super().__init__(config, self._publishers_of, self._command_givers, self._reporting)
        self._node = node
        self._answers = answers
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
            for topic, (answers, heard) in _ANSWERED.items()
            if self.unmet(
                topic,
                self._publishers_of(topic),
                meeting.publishers(self._node, answers),
                meeting.listeners(self._node, heard),
            )
        ]

    def _publishers_of(self, topic: str) -> int:
        if topic == "recorder":
            return len(self._node.get_publishers_info_by_topic(topics.RECORDER_PROGRESS))
        subscription = self._answers.get(topic)
        return 0 if subscription is None else int(subscription.get_publisher_count())

    def _command_givers(self) -> list[str]:
        """Return who publishes commands; what another type's publisher says there, nobody receives."""
        publishing = self._node.get_publishers_info_by_topic(topics.EFFORT_COMMAND)
        return meeting.names(p for p in publishing if p.topic_type == topics.JOINT_STATE_TYPE)

    def _reporting(self, topic: str) -> set[str]:
        return meeting.reporting(self._node, _ANSWERED[topic][0])

    def _on_event(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            process = process_of(message.header.frame_id) or values.get("process", "")
            if not self._node.is_second(status.name, process):
                self.hear(status.name, status.message, values)
            self._node.look_for_namesake(status.name, status.message, values)
