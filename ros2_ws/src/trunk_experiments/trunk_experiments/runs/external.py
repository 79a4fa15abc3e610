"""What a user is told of a run whose controller is somebody else's node. Pure but for the environment."""

from __future__ import annotations

import os
from collections.abc import Mapping

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event

from ..plans.plan import RunPlan


def note_of(node: str, message: str, values: Mapping[str, str]) -> str:
    """Return the line that tells a user at once of an event; empty for most."""
    if message in (Event.CONNECTED, Event.DISCONNECTED):
        who = values.get("node") or "a participant without a ROS node"
        return f"{message}: {who} ({values.get('middleware', '?')})"
    if message == Event.REFUSED and "what" in values:
        return f"{node.rpartition('/')[2]}: {values['what']}: {values.get('why', '')}"
    return ""


def connection_lines(plan: RunPlan) -> list[str]:
    """Return in five lines what a node that gives the commands subscribes to and publishes."""
    hip, trunk = plan.simulator.joints
    kind = topics.JOINT_STATE_TYPE
    at = f"{plan.namespace}/"
    reference = (
        f"{kind}: {trunk}, position [rad], of the state with its stamp, one step ahead"
        if plan.reference is not None
        else f"{kind}: nobody of ours publishes it (reference.profile is topic)"
    )
    rule = (
        "the state's, copied: it answers that state, and the plant waits for it"
        if plan.simulator.lockstep
        else "the state's, copied: it answers that state; without one it acts when it arrives"
    )
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    return [
        f"connect your node, with ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE={reach}:",
        f"  hears {at}{topics.JOINT_STATES}: {kind}: {hip}, {trunk}, position [m, rad], velocity; reliable",
        f"  hears {at}{topics.REFERENCE}: {reference}; reliable",
        f"  sends {at}{topics.EFFORT_COMMAND}: {kind}: {trunk}, effort [N m]; reliable or best effort",
        f"  header.stamp of a command: {rule}",
    ]
