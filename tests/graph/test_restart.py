"""A simulator that is started again finds the others ready: time begins anew for all of them."""

from __future__ import annotations

import pytest

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import stamp_from_ros

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

TOPICS = "[effort_command, disturbance]"


def test_two_runs_with_the_same_others(children: Children, peer: Peer) -> None:
    disturbances = peer.hear(topics.DISTURBANCE)
    others = [children.node("pid", "lockstep.enabled:=true"), children.node("disturbance")]
    for run in (1, 2):
        simulator = children.node(
            "simulator", "duration:=1.0", "lockstep.enabled:=true", f"wait_for:={TOPICS}",
            name=f"simulator_{run}",
        )  # fmt: skip
        # In lock-step it ends only where every state was answered by both.
        assert simulator.wait() == 0, simulator.stderr
        peer.until(lambda run=run: len(disturbances) == 202 * run, "each state has its disturbance")
    stamps = [stamp_from_ros(m.header.stamp) for m in disturbances]
    assert stamps[:202] == stamps[202:] == [5_000_000 * k for k in range(202)]
    for node in others:
        assert node.stop() == 0, node.stderr
