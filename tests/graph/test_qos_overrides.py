"""The loop's quality of service: best effort in real time, reliable in lock-step, and as a user says."""

from pathlib import Path

import pytest
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy

from trunk_core import topics
from trunk_runs.plan import make_plan

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

STATES, COMMANDS = f"/{topics.JOINT_STATES}", f"/{topics.EFFORT_COMMAND}"


def requested(peer: Peer, topic: str, node: str) -> QoSProfile:
    """Wait until a node is known to subscribe to a topic, and return what it requests."""
    named = peer.until(
        lambda: [
            endpoint
            for endpoint in peer.node.get_subscriptions_info_by_topic(topic)
            if endpoint.node_name == node
        ],
        f"{node} subscribes to {topic}",
    )
    profile: QoSProfile = named[0].qos_profile
    return profile


@pytest.mark.parametrize(("node", "topic"), [("pid", STATES), ("simulator", COMMANDS)])
@pytest.mark.parametrize(
    ("lockstep", "override", "reliability"),
    [
        (False, "", ReliabilityPolicy.BEST_EFFORT),
        (True, "", ReliabilityPolicy.RELIABLE),
        (False, "reliable", ReliabilityPolicy.RELIABLE),
    ],
)
def test_reliability(
    children: Children,
    peer: Peer,
    tmp_path: Path,
    node: str,
    topic: str,
    lockstep: bool,
    override: str,
    reliability: ReliabilityPolicy,
) -> None:
    overrides = {topic: {"subscription": {"reliability": override}}}
    file = tmp_path / "qos.yaml"
    file.write_text(yaml.dump({"/**": {"ros__parameters": {"qos_overrides": overrides}}}))
    plan = make_plan(
        "fig8",
        "pid",
        params=[str(file)] if override else [],
        everywhere={"lockstep.enabled": lockstep, "duration": 0.0},
    )
    plan.write_parameters(tmp_path / "params.yaml")
    child = children.node(node, "--params-file", tmp_path / "params.yaml")
    assert requested(peer, topic, node).reliability == reliability
    assert child.stop() == 0, child.stderr


@pytest.mark.virtual
@pytest.mark.parametrize(
    ("policy", "value"), [("reliability", "certain"), ("depth", "deep"), ("history", 7)]
)
def test_a_wrong_override_is_refused_by_name(
    children: Children, domain: int, policy: str, value: object
) -> None:
    name = f"qos_overrides.{STATES}.subscription.{policy}"
    child = children.node("pid", f"{name}:={value}")
    assert child.wait() == 2
    *_, line = child.stderr.splitlines()
    assert f"qos_overrides.{STATES}.subscription" in line
    assert str(value) in line or policy in line
    assert "Traceback" not in child.stderr
