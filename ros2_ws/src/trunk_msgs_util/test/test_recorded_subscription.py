"""Each message is taken once, in whatever order its copies come, and from whomever."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from trunk_msgs_util.node import recorder_node
from trunk_msgs_util.node.recorder_node import RecordedSubscription
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.topics import JOINT_STATE_TYPE

PLAIN = ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE
LOSSY = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE
LATCHED = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
PID = "pid@boot.1.2"


def message(k, frame=""):
    return layout_of(sample := JointSample(k, ("trunk",), effort=(1.0,)), frame).pack(sample)


class Topic:
    """What is taken of a topic on which nodes of other projects may publish, too."""

    def __init__(self):
        self.taken, self.warned = [], []
        node = SimpleNamespace(
            create_subscription=lambda *_, **__: SimpleNamespace(get_publisher_count=lambda: 1),
            get_logger=lambda: SimpleNamespace(warning=self.warned.append),
        )
        self.heard = RecordedSubscription(node, "a", JOINT_STATE_TYPE, None, self.taken.append)
        self._times = iter(range(10**9))

    def hear(self, number, data, *kinds):
        """A message arrives with every subscription that these kinds name."""
        info = {"publication_sequence_number": number, "source_timestamp": next(self._times)}
        for kind in kinds:
            self.heard._on_message(data, info, kind)


@given(st.data(), st.sampled_from(["", PID]))
def test_our_nodes_messages_are_taken_once_in_any_order_of_their_subscriptions(data, frame):
    """Each subscription keeps their order; equal messages, as of an operator at rest, are several."""
    topic = Topic()
    sent = [message(k // data.draw(st.integers(1, 3)), frame) for k in range(12)]
    arriving = {kind: iter(enumerate(sent, 1)) for kind in (LATCHED, PLAIN)}
    for kind in data.draw(st.permutations([LATCHED] * 12 + [PLAIN] * 12)):
        number, told = next(arriving[kind])
        info = {"publication_sequence_number": number, "source_timestamp": number}
        topic.heard._on_message(told, info, kind)
    assert sorted(topic.taken) == sorted(sent)


@pytest.mark.parametrize("frame", ["", "base_link"])
def test_strangers_are_heard_beside_our_nodes(frame):
    topic = Topic()
    for k in range(3):
        topic.hear(k + 1, message(k, PID), LATCHED, PLAIN)
        topic.hear(k + 1, message(k, frame), PLAIN)
        topic.hear(k + 1, message(k, frame), PLAIN)  # another stranger, the same content
    assert [data for data in topic.taken if PID.encode() not in data] == [
        message(k // 2, frame) for k in range(6)
    ]
    assert len(topic.taken) == 9


@pytest.mark.parametrize("frame", ["", PID])
def test_a_message_that_several_subscriptions_hear_is_taken_once(frame):
    topic = Topic()
    for k in range(4):
        topic.hear(k + 1, message(k, frame), PLAIN, LATCHED, LOSSY)
    assert topic.taken == [message(k, frame) for k in range(4)]


@pytest.mark.parametrize("kind", [PLAIN, LOSSY])
def test_a_copy_that_somebody_makes_of_our_messages_is_not_taken_again(kind):
    topic = Topic()
    for k in range(2):
        topic.hear(k + 1, message(k, PID), LATCHED)
        topic.hear(k + 1, message(k, PID), kind)
    assert topic.taken == [message(0, PID), message(1, PID)]


@pytest.mark.parametrize("times", [1, 2])
def test_a_recording_that_is_played_is_heard(times):
    """Its messages name a source that keeps nothing here."""
    topic = Topic()
    topic.hear(1, message(0, PID), LATCHED)
    played = [message(k, "pid@boot.0.0") for k in range(3)]
    for _ in range(times):
        for k in range(3):
            topic.hear(k + 1, played[k], PLAIN)
    assert topic.taken[1:] == played * times


def test_it_remembers_so_many_messages_and_no_more(monkeypatch):
    monkeypatch.setattr(recorder_node, "_REMEMBERED", 10)
    topic = Topic()
    for k in range(100):
        topic.hear(k + 1, message(k), LATCHED)
    assert len(topic.heard._taken) == 10


def test_who_publishes_another_type_is_named_once():
    topic = Topic()
    for node in ("/b", "/a", "/b"):
        topic.heard._note_type(node, "std_msgs/msg/Float64")
    lines = [
        f"a: {node} publishes std_msgs/msg/Float64 there, not {JOINT_STATE_TYPE}"
        for node in ("/a", "/b")
    ]
    assert topic.heard.of_other_types() == lines
    assert len(topic.warned) == 2
