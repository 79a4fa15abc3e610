"""Quality of service of every topic, in one place."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from trunk_core import topics

# Evidence is kept by its publisher, so that a recorder that joins late misses nothing.
EVIDENCE_DEPTH = topics.LIVE_DEPTH


def live() -> QoSProfile:
    """Return the profile of publishers in the loop: reliable, without past messages for late joiners.

    Deep, so that a bad link makes messages late before it loses any.
    """
    return QoSProfile(
        depth=EVIDENCE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def evidence() -> QoSProfile:
    """Return the profile of the evidence's own publishers, and of the recorder's subscriptions to them."""
    return QoSProfile(
        depth=EVIDENCE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def control(depth: int = 100, lockstep: bool = True) -> QoSProfile:
    """Return the profile of subscriptions in the loop: reliable in lock-step, no past messages.

    In real time they are best effort: a command that is sent again 50 ms later is worth nothing, and those
    behind it would have to wait for it.
    Deep enough for the burst with which a simulator catches up after a stall: each state is answered.
    """
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if lockstep else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


def run_information() -> QoSProfile:
    """Return the profile of events and parameters: late joiners get them all."""
    return QoSProfile(
        depth=topics.LATCHED_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def latest() -> QoSProfile:
    """Return the profile of progress: the newest value, also for late joiners."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def view() -> QoSProfile:
    """Return the profile of viewers: the newest message only, and the loop never waits for them."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


def clock() -> QoSProfile:
    """Return the profile of /clock, as ROS 2 subscribes it: best effort, the newest tick."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )
