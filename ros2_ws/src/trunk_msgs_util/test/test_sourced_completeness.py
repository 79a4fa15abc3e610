"""Whether a recording in real time is complete: by the messages of each source, and by what acted."""

import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import LEVEL_OK
from trunk_msgs_util.completeness import OF_STATES_IN_REAL_TIME, Account
from trunk_msgs_util.source import frame_of_inputs
from trunk_recording.cdr import JointStateLayout, layout_of
from trunk_recording.schemas import RunEvent

MS = 1_000_000
PLANT, PID, PUSH, OTHER = (
    f"{name}@boot.{k}.1" for k, name in enumerate(("plant", "pid", "push", "plant"))
)
TERMS = topics.controller_state("pid")
HEARD = (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND, topics.DISTURBANCE, TERMS)
STATES = 4


def told(node, message, source="", **values):
    return RunEvent(0, node, message, values, LEVEL_OK, source)


def say(completeness, topic, k, source, sample=None):
    sample = sample or JointSample(k * MS, ("trunk",), effort=(1.0,))
    data = layout_of(sample, source).pack(sample)
    completeness.take(topic, sample.stamp_ns, data, JointStateLayout.parse(data).unpack)


def say_row(completeness, k, command=PID, disturbance=PUSH, command_k=STATES - 1):
    age = float((k - command_k) * MS)
    row = JointSample(k * MS, topics.INPUT_NAMES, (0.0,) * 5, (age, *[0.0] * 4))
    say(completeness, topics.PLANT_INPUTS, k, frame_of_inputs(PLANT, command, disturbance), row)


def run(late=None, **left_out):
    """Return the check of a run of some states; ``left_out``: of each topic the states without a message.

    In the state ``late`` the command before it is still in force.
    """

    def there(word, k):
        return k not in left_out.get(word, ())

    completeness = Account("/{}".format, OF_STATES_IN_REAL_TIME, sourced=True)
    completeness.take_event(told("/plant", "configured", PLANT, kind="simulator"))
    for k in range(STATES):
        for word, topic, source in (
            ("truth", topics.GROUND_TRUTH, PLANT),
            ("measured", topics.JOINT_STATES, PLANT),
            ("commands", topics.EFFORT_COMMAND, PID),
            ("disturbances", topics.DISTURBANCE, PUSH),
        ):
            if there(word, k):
                say(completeness, topic, k, source)
        if there("rows", k):
            say_row(completeness, k, command_k=k - (k == late))
    completeness.take_event(
        told("/plant", "finished", PLANT, states=str(STATES), reason="duration reached")
    )
    return completeness


def verdict(completeness):
    return completeness.verdict(HEARD, ())


def counted(completeness, source, **counts):
    completeness.take_event(told(f"/{source}", "published", source, **counts))


def test_a_whole_run():
    completeness = run()
    counted(completeness, PID, **{"/effort_command": "4"})
    assert verdict(completeness) == (True, "duration reached")


@pytest.mark.parametrize(
    ("word", "topic"),
    [
        ("truth", topics.GROUND_TRUTH),
        ("measured", topics.JOINT_STATES),
        ("rows", topics.PLANT_INPUTS),
    ],
)
def test_every_state_is_there_with_what_acted(word, topic):
    assert verdict(run(**{word: {2}})) == (False, f"{topic}: 3 of 4 messages were recorded")


@pytest.mark.parametrize("topic", [topics.GROUND_TRUTH, topics.JOINT_STATES])
def test_a_strangers_state_does_not_stand_for_one_that_is_missing(topic):
    word = "truth" if topic == topics.GROUND_TRUTH else "measured"
    completeness = run(**{word: {1}})
    say(completeness, topic, 1, "")
    assert verdict(completeness) == (False, f"{topic}: 3 of 4 messages were recorded")
    completeness = run()
    say(completeness, topic, 1, "")
    complete, why = verdict(completeness)
    assert (complete, "5 messages for 4 states: another node" in why) == (False, True), why


def test_what_acted_but_is_not_on_record_is_named():
    complete, why = verdict(run(commands={2}))
    assert not complete
    assert (
        why
        == f"effort_command: a message of {PID} acted on the plant, stamped t = 0.002 s, but was not recorded"
    )
    complete, why = verdict(run(disturbances={0, 3}))
    assert not complete
    assert f"disturbance: a message of {PUSH} acted on the plant, stamped t = 0 s" in why
    complete, why = verdict(run(commands=set(range(STATES))))
    assert not complete
    assert why.startswith(
        "effort_command: no message was recorded, but a torque acted on the plant"
    )


def test_a_killed_node_of_which_only_unused_messages_are_missing_spoils_nothing():
    completeness = run(late=2, commands={2})
    assert verdict(completeness)[0], (
        "the command of state 2 came too late, and nobody has counted it"
    )
    counted(completeness, PID, **{"/effort_command": "4"})
    assert verdict(completeness) == (False, "effort_command: 3 of 4 messages were recorded")


def test_each_sources_messages_are_counted_alone():
    completeness = run()
    say(completeness, topics.EFFORT_COMMAND, 7, "")
    counted(completeness, PID, **{"/effort_command": "5"})
    assert verdict(completeness) == (False, "effort_command: 4 of 5 messages were recorded")


def test_strangers_that_did_not_act_spoil_nothing():
    completeness = run()
    for topic in (topics.EFFORT_COMMAND, topics.DISTURBANCE, TERMS, topics.REFERENCE):
        say(completeness, topic, 3, "")
    counted(completeness, PUSH, **{"/disturbance": "4"})
    completeness.take(topics.REFERENCE, 0, b"\x00\x01\x00\x00", JointStateLayout.parse)
    assert verdict(completeness)[0]
    assert completeness.verdict(HEARD, ("/peer publishes something else on a topic",))[0]


def test_a_strangers_command_that_acted_has_to_be_there():
    completeness = run(rows={3})
    say_row(completeness, 3, command="")
    complete, why = verdict(completeness)
    assert not complete
    assert why.startswith("effort_command: a message of a node that is not ours acted on the plant")
    assert "stamped t = 0.003 s" in why
    say(completeness, topics.EFFORT_COMMAND, 3, "base_link")
    assert verdict(completeness)[0]


def test_a_restarted_simulator_makes_two_runs():
    completeness = run()
    for source in (PLANT, OTHER):
        completeness.take_event(told("/plant", "started", source, rate="1000"))
    completeness.take_event(
        told("/plant", "finished", OTHER, states=str(STATES), reason="duration reached")
    )
    assert verdict(completeness) == (False, "it holds 2 runs: the simulator was restarted")


def test_a_node_that_outlived_a_simulator_has_messages_of_two_runs():
    completeness = Account("/{}".format, OF_STATES_IN_REAL_TIME, sourced=True)
    say(completeness, topics.EFFORT_COMMAND, 7, PID)  # of a run that nobody recorded
    rest = run()
    assert verdict(rest)[0]
    completeness.counts += rest.counts
    completeness.acted = rest.acted
    for event in rest._events:
        completeness.take_event(event)
    say(completeness, topics.EFFORT_COMMAND, 0, PID)
    assert verdict(completeness) == (False, "it holds 2 runs: the simulator was restarted")
