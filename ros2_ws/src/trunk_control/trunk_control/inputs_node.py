"""A controller's inputs: the states of its joint and its reference, each message checked."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from rclpy.node import Node

from trunk_msgs_util import topics
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.adaptive import AdaptiveSubscription
from trunk_msgs_util.node.conversions import WireReader
from trunk_msgs_util.samples import JointSample, has_doubled
from trunk_msgs_util.text import quoted_names

from .controller import JointPlaces, hip_seen
from .controller_config import ControllerConfig
from .decide import Reading

OWN_REFERENCE = topics.own_reference("~")


class Inputs:
    """Turns states into readings, with the latest reference from ``reference`` or ``~/reference``.

    Unusable messages are counted and ignored.
    """

    def __init__(self, config: ControllerConfig, refuse: Callable[[str, str], None]) -> None:
        """``refuse(what, why)`` is called for each message that is not used."""
        self._config = config
        self._refuse = refuse
        self._places = JointPlaces(config.joint, config.hip)
        self._read_state = WireReader()
        self._read_reference = WireReader()
        self._reference: float | None = None  # the latest from a topic

    def follow(self, node: Node, on_reading: Callable[[Reading], None]) -> None:
        """Subscribe to states and references on behalf of a node."""

        def on_state(data: bytes) -> None:
            reading = self.reading(data)
            if reading is not None:
                on_reading(reading)

        profile = qos.control(lockstep=self._config.lockstep)
        AdaptiveSubscription(node, topics.JOINT_STATES, on_state, profile)
        for topic in (topics.REFERENCE, OWN_REFERENCE):
            AdaptiveSubscription(node, topic, self._on_reference, qos.control(1))

    def reconfigure(self, config: ControllerConfig) -> None:
        """Take a changed configuration. A profile other than ``topic`` forgets the reference received."""
        self._config = config
        if config.reference_profile != "topic":
            self._reference = None

    def reading(self, data: bytes) -> Reading | None:
        """Return a state as the law reads it, None if something that the law needs is missing."""
        message = self._read_state(data)
        places = self._places(message.name)
        if places is None or places.last >= len(message.position):
            self._refuse("states without the joint", self._lacks(message))
            return None
        needed = self._config.uses_rate
        velocity = 0.0
        if places.last < len(message.velocity):
            velocity = message.velocity[places.joint]
            if not (needed or isfinite(velocity)):
                velocity = 0.0  # a broadcaster's NaN for what its hardware does not measure
        elif needed:
            self._refuse(
                "states without the velocity that the law needs",
                f"{len(message.velocity)} values of velocity: one for each name is needed, in rad/s, or a "
                "derivative_mode other than rate",
            )
            return None
        position = message.position[places.joint]
        hip = hip_seen(places.hip, message.position, message.velocity)
        if not (isfinite(position) and isfinite(velocity) and all(map(isfinite, hip))):
            values = ", ".join(f"{value:g}" for value in (position, velocity, *hip))
            self._refuse("states not finite", f"position and velocity are {values}")
            return None
        effort = message.effort[places.joint] if places.joint < len(message.effort) else 0.0
        return Reading(
            message.stamp_ns,
            position,
            velocity,
            hip,
            effort if isfinite(effort) else 0.0,
            self._reference is not None,
            self._reference or 0.0,
        )

    def _on_reference(self, data: bytes) -> None:
        if self._config.reference_profile != "topic":
            self._refuse(
                "references ignored (reference.profile is not 'topic')",
                f"it is {self._config.reference_profile!r}: set it to 'topic' to follow them",
            )
            return
        message = self._read_reference(data)
        try:
            if has_doubled(message.name):
                raise ValueError
            value = message.position[message.name.index(self._config.joint)]
        except (ValueError, IndexError):
            self._refuse("references without the joint", self._lacks(message))
            return
        if isfinite(value):
            self._reference = value
        else:
            self._refuse("references not finite", f"the position is {value}, rad")

    def _lacks(self, message: JointSample) -> str:
        needed = [name for name in (self._config.joint, self._config.hip) if name is not None]
        return (
            f"their names are {quoted_names(message.name)}, with {len(message.position)} values of position: "
            f"{' and '.join(map(repr, needed))} must be there, and no name twice"
        )
