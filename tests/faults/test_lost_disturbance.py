"""Real time: a disturbance whose node is gone, or hangs, in the middle of a pulse does not act for ever."""

from __future__ import annotations

import os
import signal
from itertools import pairwise

import pytest
from sensor_msgs.msg import JointState

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import stamp_from_ros

from ..graph.peer import Peer
from ..graph.processes import Children

pytestmark = pytest.mark.graph

PUSH_RAD = 0.5
TIMEOUT_NS = 2_000_000_000
PERIOD_NS = 5_000_000


def offsets(measured: list[JointState], truth: list[JointState]) -> dict[int, float]:
    """Return by how much each measured angle is off, by the state's stamp in ns."""
    true = {stamp_from_ros(m.header.stamp): m.position[1] for m in truth}
    return {
        stamp: round(m.position[1] - true[stamp], 9)
        for m in measured
        if (stamp := stamp_from_ros(m.header.stamp)) in true
    }


def test_pulse_ends_with_its_node(children: Children, peer: Peer) -> None:
    measured, truth, told = map(
        peer.hear, (topics.JOINT_STATES, topics.GROUND_TRUTH, topics.DISTURBANCE)
    )
    pulse = ("pulse.channel:=trunk_position", "pulse.start_times:=[0.0]", "pulse.duration:=3600.0")
    disturbance = children.node("disturbance", *pulse, f"pulse.magnitude:={PUSH_RAD}")
    simulator = children.node(
        "simulator", f"command_timeout:={TIMEOUT_NS / 1e9}", "wait_for:=[disturbance]"
    )

    def last_offset() -> float | None:
        found = offsets(measured[-1:], truth[-5:])
        return next(iter(found.values()), None)

    def first_unpushed_ns() -> int:
        """Return the first state without the push after one with it."""
        found = sorted(offsets(measured, truth).items())
        return next(
            after for (_, pushed), (after, offset) in pairwise(found) if pushed and not offset
        )

    peer.until(lambda: len(measured) > 20 and last_offset() == PUSH_RAD, "it is pushed")
    os.kill(disturbance.process.pid, signal.SIGSTOP)
    peer.until(lambda: last_offset() == 0.0, "the push ends while its node hangs")
    os.kill(disturbance.process.pid, signal.SIGCONT)
    peer.until(lambda: last_offset() == PUSH_RAD, "the push goes on with its node")
    assert disturbance.stop(signal.SIGKILL) == -signal.SIGKILL
    peer.until(lambda: last_offset() == 0.0, "the push ends with its node")
    assert int(peer.fresh_diagnostics("simulator")["steps without a fresh disturbance"]) > 0
    assert simulator.stop() == 0, simulator.stderr

    # The simulator's last pulse may be one that the test hears only after the node has resumed: the
    # state shows which one it was, and every stamp that the node published is known by now.
    last_ns = first_unpushed_ns() - PERIOD_NS - TIMEOUT_NS
    assert last_ns in {stamp_from_ros(m.header.stamp) for m in told}
