from unittest.mock import MagicMock

import pytest

from trunk_msgs_util.node import strangers
from trunk_msgs_util.node.discovery import Wait, Waiting, states


def test_a_line_is_said_at_once_then_every_five_seconds_and_at_once_when_it_changes():
    waiting = Waiting()
    told = [(now, waiting.line(Wait("a controller"), float(now))) for now in range(12)]
    assert [now for now, line in told if line] == [0, 5, 10]
    assert told[0][1] == "waiting for a controller"
    assert waiting.line(Wait("the recorder"), 12.0) == "waiting for the recorder"
    assert waiting.line(Wait("the recorder"), 13.0) == ""


def test_nothing_is_said_if_nobody_is_missing_and_a_node_missing_again_is_named_at_once():
    waiting = Waiting()
    assert waiting.line(Wait(), 0.0) == ""
    assert waiting.line(Wait("a controller"), 1.0)
    assert waiting.line(Wait(), 2.0) == ""
    assert waiting.line(Wait("a controller"), 3.0)


@pytest.mark.parametrize(
    ("settings", "advice"),
    [
        ({"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"}, "must be 10.0.0.1:11811 there too"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"),
        ({"ROS_DOMAIN_ID": "42"}, "ROS_DOMAIN_ID must be 42 there too, and multicast must pass"),
    ],
)
def test_whoever_is_not_met_for_ten_seconds_is_named_with_what_to_do(settings, advice):
    waiting = Waiting()
    missing = "the recorder (ros2 run trunk_msgs_util recorder)"
    lines = [waiting.line(Wait(missing, unmet=True), float(now), settings) for now in range(11)]
    assert not any("not met" in line for line in lines[:10])
    assert lines[10].startswith(f"waiting for {missing}; if it runs, it was not met: ")
    assert advice in lines[10]


@pytest.mark.parametrize(
    ("publishers", "last_ns", "refused", "expected"),
    [
        (
            [],
            None,
            {},
            "states on /s: nobody publishes them (start it: ros2 run trunk_sim simulator)",
        ),
        (
            ["/a (best effort)"],
            None,
            {},
            "the first state on /s: none has come from /a (best effort) yet",
        ),
        (
            ["/a"],
            None,
            {"states not finite": 3},
            "the first usable state on /s: states not finite 3",
        ),
        ([], 10**9, {}, "states on /s: the last one was at t = 1 s, and nobody publishes them now"),
        (["/a"], 10**9, {"states not finite": 3}, ""),
    ],
)
def test_what_is_known_of_states_that_do_not_come(publishers, last_ns, refused, expected):
    assert str(states("/s", publishers, last_ns, refused)) == expected


def test_a_topic_of_the_same_name_in_another_namespace_is_told():
    node = MagicMock()
    node.get_fully_qualified_name.return_value = "/simulator"
    node.get_topic_names_and_types.return_value = [("/elsewhere/command", ["T"]), ("/b", ["T"])]
    mine = MagicMock(node_namespace="/elsewhere", node_name="mine", topic_type="T")
    published = {"/elsewhere/command": [mine]}
    node.get_publishers_info_by_topic.side_effect = lambda topic: published.get(topic, [])
    node.get_subscriptions_info_by_topic.return_value = []
    assert strangers.near_misses(node, "/command", "/states", "T", ()) == [
        "/elsewhere/mine publishes /elsewhere/command: the topic is /command"
    ]


def test_a_domain_is_told_by_the_ports_of_its_participants(monkeypatch):
    """The first is 7400 + 250 × domain + 10 (DDSI-RTPS); 7410 is of domain 0."""
    holders = {7410: "ours", 7659: "nobody's", 7660: "a talker", 7900: "b", 7910: "a listener"}
    monkeypatch.setattr(strangers, "_port_holders", lambda: holders)
    node = MagicMock()
    node.context.get_domain_id.return_value = 0
    assert strangers.near_misses(node, "/a", "/b", "T", ()) == [
        f"in ROS_DOMAIN_ID {domain} there is {who}: this is 0; give both the same"
        for domain, who in ((1, "a talker"), (2, "a listener"))
    ]
