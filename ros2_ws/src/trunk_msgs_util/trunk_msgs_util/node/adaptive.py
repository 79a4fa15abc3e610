"""`AdaptiveSubscription`: reliable, until a best-effort publisher shows that it would not be heard."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from ..parameters.declarations import ParameterError
from . import qos

_OVERRIDES = (
    "reliability: reliable or best_effort; history: keep_last or keep_all; depth: an integer > 0"
)


class AdaptiveSubscription:
    """The loop's subscription to serialized JointState messages, from publishers of either reliability.

    DDS matches a reliable subscription with reliable publishers alone, and a best-effort one with all; but
    only a reliable one has lost messages sent again. So it asks for best effort
    once a publisher offers only that.

    Users may set depth, history and reliability themselves, by ROS's own parameters
    ``qos_overrides.TOPIC.subscription.…``.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        callback: Callable[[bytes], None],
        profile: QoSProfile | None = None,
    ) -> None:
        """``profile``: by default that of `qos.control`. Raises ParameterError for a wrong override."""
        self._node = node
        self._topic = topic
        self._callback = callback
        self._profile = profile or qos.control()
        self._subscription = self._subscribe(QoSOverridingOptions.with_default_policies())

    def _subscribe(self, overrides: QoSOverridingOptions | None) -> Subscription:
        try:
            return self._node.create_subscription(
                JointState,
                self._topic,
                self._callback,
                self._profile,
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._incompatible),
                qos_overriding_options=overrides,
            )
        except (RuntimeError, TypeError, ValueError, InvalidParameterTypeException) as error:
            # rclpy says which policy, but not of which topic.
            name = f"qos_overrides.{self._node.resolve_topic_name(self._topic)}.subscription"
            raise ParameterError(name, str(error), _OVERRIDES) from None

    @property
    def topic_name(self) -> str:
        """The topic's absolute name."""
        return str(self._subscription.topic_name)

    def get_publisher_count(self) -> int:
        """Return the number of matched publishers."""
        return int(self._subscription.get_publisher_count())

    def _incompatible(self, event: QoSRequestedIncompatibleQoSInfo) -> None:
        best_effort = self._profile.reliability == ReliabilityPolicy.BEST_EFFORT
        if event.last_policy_kind != QoSPolicyKind.RELIABILITY or best_effort:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self._node.get_logger().warning(
                f"a publisher of {self.topic_name} is not heard: its {policy} is incompatible with "
                "this node's"
            )
            return
        self._profile = QoSProfile(
            depth=self._profile.depth,
            reliability=ReliabilityPolicy.BEST_EFFORT,
            durability=self._profile.durability,
        )
        self._node.get_logger().info(
            f"a publisher of {self.topic_name} is best effort: heard, but a lost message is not sent again"
        )
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe(None)
