"""Who is awaited, who is ready, and which controllers may act at the same time."""

from itertools import permutations
from unittest.mock import Mock

import pytest

from trunk_core.topics import UNKNOWN_NODE
from trunk_sim.config import TrunkSimulator
from trunk_sim.participants_node import Participants

COMMAND = {"answers": "effort_command"}


def participants(config=None, counts=None, controllers=(), reporting=(), hearing=True):
    counts = {"effort_command": 1} if counts is None else counts
    those = Participants(Mock(), config or TrunkSimulator(), {})
    those._answering_count = lambda topic: counts.get(topic, 0)
    those._command_givers = lambda: list(controllers)
    those._reporting = lambda topic: set(reporting)
    those._hearing = lambda topic: hearing
    those._not_met = list
    return those


def test_a_node_is_ready_when_it_says_so():
    those = participants(TrunkSimulator(wait_for=("effort_command", "recorder")))
    assert those.missing(0.0) == ["effort_command", "recorder"]
    those.hear("/pid", "ready", COMMAND)
    assert those.missing(0.0) == ["recorder"]
    those.hear("/recorder", "ready", {"answers": "recorder"})
    assert those.missing(0.0) == []


def test_a_stranger_is_ready_when_it_has_been_matched_for_a_second():
    counts = {"effort_command": 1}
    those = participants(counts=counts)
    assert those.missing(10.0) == ["effort_command"]
    assert those.missing(10.9) == ["effort_command"]
    assert those.missing(11.1) == []
    counts["effort_command"] = 0
    assert those.missing(12.0) == ["effort_command"]
    counts["effort_command"] = 1
    assert those.missing(12.5) == ["effort_command"]


def test_one_that_is_not_known_to_hear_states_is_ready_after_ten():
    those = participants(hearing=False)
    assert those.missing(10.0) == those.missing(19.9) == ["effort_command"]
    assert those.missing(20.1) == []


def test_a_node_whose_events_are_under_way_is_no_stranger():
    those = participants(controllers=["/pid"], reporting=["/pid"])
    assert those.missing(10.0) == those.missing(100.0) == ["effort_command"]
    those.hear("/pid", "configured", {})
    assert those.missing(101.0) == ["effort_command"]
    those.hear("/pid", "activated", {})
    assert those.missing(102.0) == []


def test_strangers_are_nodes_that_say_nothing_about_themselves():
    those = participants(controllers=["/pid", "/mine"])
    those.hear("/pid", "configured", {"process": "1"})
    assert those.strangers() == ["/mine"]


def test_a_standby_node_is_awaited_however_long_it_has_been_matched():
    those = participants(controllers=["/pid"])
    those.hear("/pid", "configured", {})
    assert those.missing(10.0) == those.missing(15.0) == ["effort_command"]
    those.hear("/pid", "activated", {})
    those.hear("/pid", "ready", COMMAND)
    assert those.missing(15.0) == []
    assert those.idle() == []
    those.hear("/pid", "deactivated", {})  # before the simulator that hears it began
    assert those.missing(16.0) == ["effort_command"]
    assert those.idle() == ["/pid"]
    those.hear("/fuzzy_pid", "ready", COMMAND)
    assert those.idle() == []  # the other one acts
    those.hear("/fuzzy_pid", "deactivated", {})
    assert those.idle() == ["/fuzzy_pid", "/pid"]
    those.hear("/pid", "activated", {})  # not ready a second time: it was before
    assert those.missing(16.0) == []
    assert those.idle() == []


def test_all_controllers_that_take_turns_are_awaited():
    those = participants(TrunkSimulator(controllers=("pid", "fuzzy_pid")))
    those.hear("/robot/pid", "ready", COMMAND)
    assert those.missing(0.0) == ["fuzzy_pid"]
    those.hear("/robot/fuzzy_pid", "ready", COMMAND)
    assert those.missing(0.0) == []
    those.hear("/robot/fuzzy_pid", "deactivated", {})  # its turns come again
    assert those.missing(0.0) == []


@pytest.mark.parametrize("anew", ["cleaned up", "configured"])  # in order, or started anew
def test_a_node_that_reopens_its_topics_is_awaited_again(anew):
    those = participants(TrunkSimulator(controllers=("pid",)), controllers=["/pid"])
    for message in ("configured", "activated"):
        those.hear("/pid", message, {})
    those.hear("/pid", "ready", COMMAND)
    assert those.missing(0.0) == []
    those.hear("/pid", anew, {})
    those.hear("/pid", "activated", {})
    assert those.missing(0.5) == ["effort_command", "pid"]
    assert those.describe("effort_command") == "/pid (effort_command)"
    those.hear("/pid", "ready", COMMAND)
    assert those.missing(0.5) == []


@pytest.mark.parametrize(
    ("turns", "publishing", "acting"),
    [
        ((), ["/pid"], ["/pid"]),
        ((), ["/pid", "/fuzzy_pid"], ["/fuzzy_pid", "/pid"]),
        ((), ["/pid", "/pid"], ["/pid", "/pid"]),
        (("pid", "fuzzy_pid"), ["/pid", "/fuzzy_pid"], ["/fuzzy_pid"]),
        (("pid", "fuzzy_pid"), ["/pid", "/fuzzy_pid", "/lqr"], ["/fuzzy_pid", "/lqr"]),
        (("pid", "fuzzy_pid"), ["/pid", "/fuzzy_pid", "/pid"], ["/fuzzy_pid", "/pid"]),
    ],
)
def test_which_controllers_act_at_the_same_time(turns, publishing, acting):
    those = participants(TrunkSimulator(controllers=turns), controllers=publishing)
    assert those.acting() == acting


def test_a_standby_controller_does_not_act():
    those = participants(controllers=["/pid", "/fuzzy_pid"])
    assert those.unsettled(5.0)
    those.hear("/fuzzy_pid", "configured", {})
    assert those.acting() == ["/pid"]
    assert not those.unsettled(5.0)
    those.hear("/fuzzy_pid", "activated", {})
    assert len(those.acting()) == 2
    those.hear("/pid", "deactivated", {})
    assert those.acting() == ["/fuzzy_pid"]


def test_an_unknown_node_is_awaited_but_not_for_ever():
    those = participants(controllers=["/pid", f"/{UNKNOWN_NODE}"])
    assert those.rivals() == []  # nobody can be told whom to stop
    assert those.unsettled(5.0)
    assert those.unsettled(8.9)
    assert not those.unsettled(9.1)


def test_rivals_are_judged_by_one_look_at_the_graph():
    """Discovery goes on between two looks: a node that one knows by name may be unknown to the other."""
    named = ["/fuzzy_pid", "/pid"]
    looks = [named, ["/fuzzy_pid", f"/{UNKNOWN_NODE}"], ["/fuzzy_pid"]]
    for order in permutations(looks):
        those = participants()
        those._command_givers = iter(order).__next__
        assert [those.rivals() for _ in order] == [look if look is named else [] for look in order]
        those = participants()
        those._command_givers = iter(order).__next__
        assert [those.unsettled(5.0) for _ in order] == [len(look) > 1 for look in order]


def test_silent_nodes_are_named():
    those = participants()
    assert those.describe("effort_command") == "anyone (effort_command)"
    those.hear("/pid", "ready", COMMAND)
    those.hear("/fuzzy_pid", "ready", COMMAND)
    assert those.describe("effort_command") == "/fuzzy_pid or /pid (effort_command)"
    those.hear("/pid", "deactivated", {})
    assert those.describe("effort_command") == "/fuzzy_pid (effort_command)"
    those.hear("/fuzzy_pid", "deactivated", {})
    assert those.describe("effort_command") == "/fuzzy_pid or /pid (effort_command; inactive)"


def test_a_ready_node_is_met_once_its_publisher_has_a_name_and_it_subscribes():
    those = participants()
    topic = "effort_command"
    assert not those.unmet(topic, 0, set(), set())  # nobody says that it is ready
    those.hear("/pid", "ready", COMMAND)
    assert those.unmet(topic, 0, set(), set())  # its words were quicker than discovery
    assert those.unmet(topic, 1, set(), set())  # discovered, but not yet by name
    assert those.unmet(topic, 1, {"/pid"}, {"/recorder"})
    assert not those.unmet(topic, 1, {"/pid"}, {"/pid", "/recorder"})
    assert not those.unmet(topic, 0, set(), set())  # it has gone: nobody is left to wait for
