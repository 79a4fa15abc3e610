"""Whether a recording in lock-step is complete: its messages against the counts that its nodes report."""

import pytest

from trunk_core import topics
from trunk_core.topics import LEVEL_OK
from trunk_msgs_util.completeness import Account
from trunk_recording.schemas import ParameterChange, RunEvent

HEARD = (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND)


def told(node, message, **values):
    return RunEvent(0, node, message, values, LEVEL_OK)


def begin_twice(completeness):
    """The recorder came after the first run: of that one, only events and commands were left to hear."""
    for message, values in (("started", {}), ("started", {}), ("finished", {"states": "3"})):
        completeness.take_event(told("/plant", message, **values))


@pytest.fixture
def whole():
    """Return the completeness of a run of three states, each answered, that was recorded in full."""
    completeness = Account("/{}".format)
    completeness.counts.update({("", topic): 3 for topic in HEARD})
    completeness.take_event(told("/plant", "configured", kind="simulator"))
    completeness.take_event(told("/plant", "finished", states="3", reason="duration reached"))
    completeness.take_event(told("/pid", "published", **{f"/{topics.EFFORT_COMMAND}": "3"}))
    return completeness


def test_a_whole_run(whole):
    assert whole.verdict(HEARD, ()) == (True, "duration reached")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (
            lambda t: t.take_event(told("/plant", "started")),
            "stopped before the run was finished",
        ),  # anew
        (lambda t: t.take_event(told("/plant", "failed", reason="diverged")), "diverged"),
        (lambda t: setattr(t, "runs", 2), "it holds 2 runs"),
        (begin_twice, "it holds 2 runs"),
        (lambda t: t.counts.subtract([("", topics.JOINT_STATES)]), "joint_states: 2 of 3 messages"),
        (
            lambda t: t.counts.update([("", topics.GROUND_TRUTH)]),
            "4 messages for 3 states: another node",
        ),
        (
            lambda t: t.counts.subtract([("", topics.EFFORT_COMMAND)]),
            "effort_command: 2 of 3 messages",
        ),
    ],
)
def test_what_makes_it_incomplete(whole, change, reason):
    change(whole)
    complete, why = whole.verdict(HEARD, ())
    assert (complete, reason in why) == (False, True), why


@pytest.mark.parametrize("count", ["", "many", "-1", "2.0", "9" * 5000])
@pytest.mark.parametrize(
    ("message", "name"),
    [("finished", "states"), ("published", "/effort_command")],
)
def test_an_event_without_a_count_is_from_no_node_of_ours(whole, message, name, count):
    before = whole.verdict(HEARD, ())
    with pytest.raises(ValueError, match=f"{message} without a count of {name}"):
        whole.take_event(told("/plant", message, **{name: count}))
    assert whole.verdict(HEARD, ()) == before


@pytest.mark.parametrize("topic", [topics.DISTURBANCE, topics.controller_state("pid")])
def test_a_stranger_on_a_topic_of_one_node(whole, topic):
    whole.take_event(told("/node", "published", **{f"/{topic}": "3"}))
    whole.counts.update({("", topic): 4})
    complete, why = whole.verdict((*HEARD, topic), ())
    assert (complete, "another node publishes there too" in why) == (False, True), why


def test_messages_that_could_not_be_received(whole):
    assert whole.verdict(HEARD, ("a stranger", "another")) == (False, "a stranger; another")


def test_a_controller_from_which_nothing_was_received():
    """It was there before the recorder, and ended before the two had discovered each other."""
    completeness = Account("/{}".format)
    completeness.counts.update({("", topics.GROUND_TRUTH): 3, ("", topics.JOINT_STATES): 3})
    completeness.take_event(told("/simulator", "finished", states="3", reason="finished"))
    assert completeness.verdict(HEARD, ()) == (True, "finished"), "nobody held the trunk"
    completeness.driven = True
    complete, why = completeness.verdict(HEARD, ())
    assert not complete
    assert why.startswith(
        "effort_command: no message was recorded, but a torque acted on the plant"
    )


def test_in_lockstep_every_state_has_an_answer():
    completeness = Account("/{}".format, HEARD)
    completeness.counts.update(
        {("", topics.GROUND_TRUTH): 3, ("", topics.JOINT_STATES): 3, ("", topics.EFFORT_COMMAND): 2}
    )
    completeness.take_event(told("/simulator", "finished", states="3"))
    assert completeness.verdict(HEARD, ()) == (
        False,
        "effort_command: 2 of 3 messages were recorded",
    )


def test_a_node_from_which_only_the_parameters_arrived(whole):
    for node in ("/pid", "/lqr"):
        whole.take_parameters(ParameterChange(0, node, {"kp": 1.0}, {}))
    why = "/lqr: its parameters were recorded, but none of its events"
    assert whole.verdict(HEARD, ()) == (False, why)
    whole.take_event(told("/lqr", "configured", kind="lqr"))
    assert whole.verdict(HEARD, ())[0]


def test_two_controllers_report_their_counts_together(whole):
    whole.take_event(told("/lqr", "published", **{f"/{topics.EFFORT_COMMAND}": "2"}))
    why = "effort_command: 3 of 5 messages were recorded"
    assert whole.verdict(HEARD, ()) == (False, why)


def test_only_a_robots_run_has_no_end_to_wait_for():
    account = Account("/{}".format)
    account.take_event(told("/pid", "configured", kind="pid"))
    account.take_parameters(ParameterChange(0, "/pid", {"duration": 0.0}, {}))
    account.take_parameters(ParameterChange(0, "/mine", {"duration": "abc"}, {}))
    assert not account.begun
    assert not account.of_robot
    account.counts["", topics.JOINT_STATES] += 1
    assert account.of_robot
    account.take_event(told("/plant", "configured", kind="simulator"))
    account.take_parameters(ParameterChange(0, "/plant", {"duration": 0.0}, {}))
    assert not account.of_robot
