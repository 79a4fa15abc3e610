"""Each message is taken once, in whatever order its copies come, and from whomever."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from trunk_core.samples import JointSample
from trunk_core.topics import JOINT_STATE_TYPE
from trunk_msgs_util.node import recorder_node
from trunk_msgs_util.node.recorder_node import RecordedSubscription
from trunk_recording.cdr import layout_of

PLAIN = ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE
LOSSY = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE
LATCHED = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
PID = "pid@boot.1.2"


def message(k, frame=""):
    return layout_of(sample := JointSample(k, ("trunk",), effort=(1.0,)), frame).pack(sample)


class Topic:
    """A topic with strangers on it, and what was taken of it."""

    def __init__(self):
        self.taken, self.warned = [], []
        node = SimpleNamespace(
            resolve_topic_name=lambda name: f"/{name}",
            create_subscription=lambda *_, **__: SimpleNamespace(get_publisher_count=lambda: 1),
            get_logger=lambda: SimpleNamespace(warning=self.warned.append),
        )
        self.heard = RecordedSubscription(node, "a", JOINT_STATE_TYPE, None, self.taken.append)
        self._times = iter(range(10**9))

    def strangers(self, *kinds):
        for kind in kinds:
            self.heard._hear_passing(kind)

    def kept(self, number, data):
        self.heard._on_kept(data, {"publication_sequence_number": number})

    def passing(self, number, data, kind=PLAIN, time=None):
        time = next(self._times) if time is None else -1 - time
        info = {"publication_sequence_number": number, "source_timestamp": time}
        self.heard._on_passing(data, info, kind)


@given(st.data(), st.sampled_from(["", PID]))
def test_our_nodes_messages_are_taken_once_in_any_order_of_their_copies(data, frame):
    """Copies on one topic keep their order; equal messages, as of an operator at rest, are several."""
    topic = Topic()
    topic.strangers(PLAIN)
    sent = [message(k // data.draw(st.integers(1, 3)), frame) for k in range(12)]
    copies = {True: iter(enumerate(sent, 1)), False: iter(enumerate(sent, 1))}
    for kept in data.draw(st.permutations([True] * 12 + [False] * 12)):
        (topic.kept if kept else topic.passing)(*next(copies[kept]))
    assert sorted(topic.taken) == sorted(sent)


@pytest.mark.parametrize("frame", ["", "base_link"])
def test_strangers_are_heard_beside_our_nodes(frame):
    topic = Topic()
    topic.strangers(PLAIN, LOSSY)
    for k in range(3):
        topic.kept(k + 1, message(k, PID))
        topic.passing(k + 1, message(k, PID))
        topic.passing(k + 1, message(k, frame))
        topic.passing(k + 1, message(k, frame))  # another stranger, the same content
    assert [data for data in topic.taken if PID.encode() not in data] == [
        message(k // 2, frame) for k in range(6)
    ]
    assert len(topic.taken) == 9


@pytest.mark.parametrize("frame", ["", PID])
def test_a_message_that_several_subscriptions_hear_is_taken_once(frame):
    topic = Topic()
    topic.strangers(PLAIN, LOSSY, LATCHED)
    for k in range(4):
        for kind in (PLAIN, LATCHED, LOSSY):
            topic.passing(k + 1, message(k, frame), kind, time=k)
    assert topic.taken == [message(k, frame) for k in range(4)]


@pytest.mark.parametrize("before", [0, 1, 2])
def test_a_copy_that_somebody_makes_of_our_messages_is_not_taken_again(before):
    """Also if it arrives with the live one ``before`` the first message that is kept."""
    topic = Topic()
    topic.strangers(PLAIN)
    for _ in range(before):  # the live copy, and somebody's
        topic.passing(1, message(0, PID))
    topic.kept(1, message(0, PID))
    for _ in range(2 - before):
        topic.passing(1, message(0, PID))
    topic.passing(2, message(1, PID))
    topic.kept(2, message(1, PID))
    assert topic.taken == [message(0, PID), message(1, PID)]


@pytest.mark.parametrize("times", [1, 2])
def test_a_recording_that_is_played_is_heard(times):
    """Its messages name a source that keeps nothing here."""
    topic = Topic()
    topic.strangers(PLAIN)
    topic.kept(1, message(0, PID))
    played = [message(k, "pid@boot.0.0") for k in range(3)]
    for _ in range(times):
        for k in range(3):
            topic.passing(k + 1, played[k])
    assert topic.taken[1:] == played * times


def test_it_remembers_so_many_copies_and_no_more(monkeypatch):
    monkeypatch.setattr(recorder_node, "_REMEMBERED", 10)
    topic = Topic()
    topic.strangers(PLAIN)
    for k in range(100):
        topic.kept(k + 1, message(k))
        topic.passing(1000 + k, message(k))
    for remembered in (topic.heard._kept_alone._counts, topic.heard._live_alone._counts):
        assert len(remembered) == 10
    assert len(topic.heard._passed) == 10


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
