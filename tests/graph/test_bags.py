"""A run's folder is a bag to rosbag2's conventions: read, played and recorded again."""

from collections import Counter, defaultdict
from pathlib import Path

import pytest
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader

from trunk_core.topics import Event
from trunk_msgs_util.node.recorder_node import _MESSAGES
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph


def content(path: Path) -> dict[str, list[bytes]]:
    """Return each topic's messages."""
    recording, found = Recording.open(path), defaultdict(list)
    for topic in recording.topics:
        for _, messages in recording.messages(topic):
            found[topic] += [message.rstrip(b"\0") for message in messages]  # DDS pads them
    return found


def test_a_run_is_a_bag_that_can_be_played_into_our_recorder(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """As `ros2 bag play` does: publishers that offer what was offered, in the order of the log times."""
    run = children.trunk("run", "demo", "--duration", 1, "--lockstep", "--output", "run")
    assert run.wait() == 0, run.stderr
    children.none_left()
    recorder = children.node("recorder", "output:=again.mcap")
    peer.until_event("recorder", Event.ACTIVATED)
    peer.events.clear()
    with AnyReader([tmp_path / "run"]) as bag:
        count = bag.message_count
        assert count == sum(map(len, content(tmp_path / "run" / "run.mcap").values()))
        players: dict[str, Publisher] = {}
        for connection in bag.connections:
            (offered,) = connection.ext.offered_qos_profiles
            assert connection.digest.startswith("RIHS01_")
            profile = QoSProfile(
                depth=offered.depth,
                reliability=ReliabilityPolicy[offered.reliability.name],
                durability=DurabilityPolicy[offered.durability.name],
            )
            kind = _MESSAGES[connection.msgtype]
            players[connection.topic] = peer.node.create_publisher(kind, connection.topic, profile)
        for name, player in players.items():
            if not name.endswith("/state"):  # the recorder finds those when somebody publishes
                peer.until(player.get_subscription_count, f"the recorder listens to {name}")
        peer.until(players["/fuzzy_pid/state"].get_subscription_count, "it listens to terms too")
        for connection, _, data in bag.messages():
            players[connection.topic].publish(data)
            peer.spin()
    peer.until_recorded(count)
    assert recorder.stop() == 1, recorder.stderr  # nobody plays what only a recorder hears
    before, after = (content(tmp_path / name) for name in ("run/run.mcap", "again.mcap"))
    assert before.keys() == after.keys()
    for topic, messages in before.items():
        if topic.startswith("/run/"):  # the new recorder's own are among them
            assert not Counter(messages) - Counter(after[topic])
        else:
            assert after[topic] == messages
