"""The replay step by step: a short run with everything in it, and single numbers planted in its copies."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nextafter

import numpy as np
import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.plans.turns import Swap
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay, replay_plant
from trunk_experiments.replay.driven import driven_controllers
from trunk_experiments.replay.replay import (
    judged,
    replay_controllers,
    replay_disturbance,
    worth_compiling,
)
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.topic import RecordingError
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.topics import STATE_NAMES
from trunk_sim.disturbances import Disturbance

from ..edited import NONE, copied
from .runs import MS, STATES, planted

SETTINGS = [
    "simulator.sensor.delay=0.003",
    "simulator.sensor.position_noise=0.001",
    "simulator.sensor.velocity_noise=0.01",
    "simulator.sensor.velocity_bias=0.1",
    "simulator.fall.angle=0.53",
    "disturbance.pulse.start_times=[0.01]",
    "disturbance.pulse.duration=0.005",
    "disturbance.sine.channel=hip_effort",
    "disturbance.sine.amplitude=2.0",
    "disturbance.sine.frequency=20.0",
    "disturbance.noise.channel=hip_position",
    "disturbance.noise.rms=0.1",
]
CHANGES = {
    "simulator": [Change(30 * MS, {"plant.length": 1.1}), Change(45 * MS, None)],
    "computed_torque": [Change(12 * MS, {"gains.p": 50.0}), Change(15 * MS, None)],
    "disturbance": [Change(33 * MS, {"sine.amplitude": -3.0})],
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "whole.mcap"
    swaps = [Swap(0.02, "fuzzy_pid"), Swap(0.04, "computed_torque")]
    plan = make_plan(
        "fig8",
        "computed_torque",
        settings=SETTINGS,
        everywhere={"duration": 0.06, "update_rate": 1000.0},
        swaps=swaps,
    )
    record_offline(replace(plan, changes=CHANGES), path)
    return path


def all_checked(run, until_ns=None):
    """Return all that the three replays check, by name."""
    return {
        "commands": list(replay_controllers(run, driven_controllers(run), until_ns)),
        "disturbances": list(replay_disturbance(run, until_ns)),
        "plant": list(PlantReplay(run, until_ns)),
    }


def differences(run, until_ns=None):
    return [d for found in all_checked(run, until_ns).values() for one in found for d in one.found]


def steps(checked):
    return {name: sum(one.steps for one in found) for name, found in checked.items()}


def test_what_was_recorded_follows_from_itself(whole):
    run = RecordedRun.open(whole)
    assert [event.stamp_ns for event in run.events if event.message == "fell"]
    checked = all_checked(run)
    assert differences(run) == []
    assert steps(checked) == {"commands": STATES, "disturbances": STATES + 1, "plant": STATES}
    by = {one.controller for one in checked["commands"]}
    assert by == {"computed_torque", "fuzzy_pid"}


def test_stretches_are_passed_over_in_one(whole, way):
    checked = all_checked(RecordedRun.open(whole))
    longest = {name: max(one.steps for one in found) for name, found in checked.items()}
    if way == "step by step":
        assert set(longest.values()) == {1}
    elif way == "by windows":
        assert longest == {"commands": 7, "disturbances": 7, "plant": 7}
    else:  # up to the changes, which come after 12, 15, 20, 30, 33, 40 and 45 ms
        assert longest == {"commands": 21, "disturbances": 34, "plant": 30}


def test_each_check_says_where_it_begins_and_ends(whole):
    for found in all_checked(RecordedRun.open(whole)).values():
        at = 0
        for one in found:
            assert one.stamp_ns == at * MS
            at += one.steps
            last_ns = one.stamp_ns if one.last_ns is None else one.last_ns
            assert last_ns == (at - 1) * MS


@pytest.mark.parametrize("until", [0, 17, 60, 90])
def test_nothing_is_judged_after_the_last_stamp_that_counts(whole, until):
    checked = all_checked(RecordedRun.open(whole), until * MS)
    count = min(until + 1, STATES)
    assert steps(checked) == {
        "commands": count,
        "disturbances": min(until + 1, STATES + 1),
        "plant": count,
    }


JOINTS = ("hip", "trunk")
joint = pytest.mark.parametrize("column", [0, 1], ids=JOINTS)


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("topic", ["ground_truth/joint_states", "joint_states"])
@pytest.mark.parametrize("quantity", ["position", "velocity", "effort"])
@joint
@pytest.mark.parametrize("step", [0, 25, 60])
def test_one_bit_of_a_state_is_found_in_its_place(whole, tmp_path, topic, quantity, column, step):
    run = planted(whole, topic, step, quantity, column)
    found = [d for one in PlantReplay(run) for d in one.found if d.topic == topic]
    assert [(d.stamp_ns, d.field) for d in found[:1]] == [
        (step * MS, f"{quantity}[{JOINTS[column]}]")
    ]


@pytest.mark.parametrize("quantity", ["position", "effort"])
@joint
def test_one_bit_of_a_disturbance_is_found_in_its_place(whole, tmp_path, quantity, column):
    run = planted(whole, "disturbance", 20, quantity, column)
    (found,) = [d for one in replay_disturbance(run) for d in one.found]
    assert (found.stamp_ns, found.field) == (20 * MS, f"{quantity}[{JOINTS[column]}]")


@pytest.mark.parametrize("step", [0, 25, 60])
def test_one_bit_of_a_command_is_found_in_its_place(whole, tmp_path, step):
    run = planted(whole, "effort_command", step, "effort", 0)
    (found,) = [d for one in replay_controllers(run, driven_controllers(run)) for d in one.found]
    assert (found.stamp_ns, found.topic) == (step * MS, "effort_command")
    assert found.field == "effort[trunk]"
    assert found.recorded == nextafter(found.computed, inf)


@pytest.mark.slow
@pytest.mark.parametrize("column", range(len(STATE_NAMES)), ids=STATE_NAMES)
def test_one_bit_of_a_controllers_terms_is_found_in_its_place(whole, tmp_path, column):
    topic = "fuzzy_pid/state"
    run = planted(whole, topic, 5, "position", column)
    (found,) = [d for one in replay_controllers(run, driven_controllers(run)) for d in one.found]
    assert (found.stamp_ns, found.topic) == (25 * MS, topic)
    assert found.field == f"position[{STATE_NAMES[column]}]"


def without(topic, index):
    def edit(messages):
        messages.remove([m for m in messages if m[0] == "/" + topic][index])

    return edit


def test_a_command_without_its_state_cannot_be_computed(whole, tmp_path):
    copy = copied(whole, tmp_path / "p.mcap", without("joint_states", 25), digests=NONE)
    run = RecordedRun(copy)
    first = next(d for one in replay_controllers(run, driven_controllers(run)) for d in one.found)
    assert first == (25 * MS, "joint_states", "missing", 0.0, 0.0)


def test_terms_at_another_time_are_missing_and_unexpected(tmp_path):
    """The controller updates every 2 ms: its output of 10 ms is stamped 11 ms."""
    path = tmp_path / "slow.mcap"
    rates = {"simulator.update_rate": 1000.0, "pid.update_rate": 500.0}
    settings = [f"{name}={rate}" for name, rate in rates.items()]
    record_offline(make_plan("fig6", "pid", settings=settings, everywhere={"duration": 0.02}), path)
    table = RecordedRun.open(path).table("pid/state")
    assert table.stamp_ns[5] == 10 * MS
    values = {q: table.values(q)[5].tolist() for q in ("position", "velocity", "effort")}
    sample = JointSample(11 * MS, tuple(table.names), **values)

    def later(messages):
        message = [m for m in messages if m[0] == "/pid/state"][5]
        message[2] = layout_of(sample).pack(sample)

    run = RecordedRun(copied(path, tmp_path / "p.mcap", later, digests=NONE))
    found = [d for one in replay_controllers(run, driven_controllers(run)) for d in one.found]
    assert found == [
        (10 * MS, "pid/state", "missing", 0.0, 0.0),
        (11 * MS, "pid/state", "unexpected", 0.0, 0.0),
    ]


def test_a_missing_measurement_does_not_stop_the_plant(whole, tmp_path):
    copy = copied(whole, tmp_path / "p.mcap", without("joint_states", 25), digests=NONE)
    checked = list(PlantReplay(RecordedRun(copy)))
    assert sum(one.steps for one in checked) == STATES
    assert [d for one in checked for d in one.found] == []


def test_without_a_command_the_next_state_does_not_follow(whole, tmp_path):
    copy = copied(whole, tmp_path / "p.mcap", without("effort_command", 25), digests=NONE)
    found = [d for one in PlantReplay(RecordedRun(copy)) for d in one.found]
    assert {d.stamp_ns for d in found} == {26 * MS}


def test_without_its_message_no_disturbance_acts(whole, tmp_path):
    copy = copied(whole, tmp_path / "p.mcap", without("disturbance", 12), digests=NONE)
    run = RecordedRun(copy)
    assert replay.acting_at(run.table("disturbance"), 12 * MS) == Disturbance()
    found = [d for one in PlantReplay(run) for d in one.found]
    assert {(d.stamp_ns, d.topic) for d in found} == {
        (12 * MS, "joint_states"),  # the pulse is on this measurement
        (13 * MS, "ground_truth/joint_states"),  # the force was on this step
    }


def test_a_disturbance_is_read_by_its_channels(whole):
    acting = replay.acting_at(RecordedRun.open(whole).table("disturbance"), 12 * MS)
    assert acting.hip_force == pytest.approx(2.0 * np.sin(2.0 * np.pi * 20.0 * 0.012))
    assert acting.trunk_torque == 0.0
    assert acting.hip_offset != 0.0
    assert acting.trunk_offset != 0.0


def test_a_fall_that_is_not_marked_is_found(whole, tmp_path):
    def edit(messages):
        messages[:] = [m for m in messages if m[0] != "/run/events" or b"fell" not in m[2]]

    marked = [e.stamp_ns for e in RecordedRun.open(whole).events if e.message == "fell"]
    run = RecordedRun(copied(whole, tmp_path / "p.mcap", edit, digests=NONE))
    found = [d for one in PlantReplay(run) for d in one.found]
    assert [(d.stamp_ns, d.field, d.recorded, d.computed) for d in found] == [
        (stamp_ns, "fell", 0.0, 1.0) for stamp_ns in marked
    ]


@pytest.mark.parametrize(
    ("until", "kept"), [(None, [0, 5, 9, 7]), (9, [0, 5, 9, 7]), (8, [0, 5]), (-1, [])]
)
def test_stamps_are_judged_up_to_the_first_that_is_too_late(until, kept):
    assert judged(np.array([0, 5, 9, 7]), until).tolist() == kept


def test_a_run_without_disturbances_is_passed_over_too(tmp_path, way):
    path = tmp_path / "quiet.mcap"
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.02, "update_rate": 1000.0})
    record_offline(plan, path)
    checked = list(PlantReplay(RecordedRun.open(path)))
    assert [d for one in checked for d in one.found] == []
    # The last state is looked at.
    assert len(checked) == {"step by step": 21, "by stretches": 2, "by windows": 4}[way]
    assert replay_plant.acting_at(RecordedRun.open(path).table("disturbance"), 0) == Disturbance()


@pytest.mark.parametrize(
    ("stamps", "worth"),
    [
        (range(100), True),
        (range(99), False),
        ([*range(99), 98], False),  # compiled code takes each stamp once,
        ([*range(98), 99, 98], False),  # and in their order
        ([5, *range(99)], False),
    ],
    ids=["long enough", "too short", "a stamp twice", "the last two swapped", "the first is late"],
)
def test_when_a_replay_is_compiled(stamps, worth, monkeypatch):
    monkeypatch.setattr(replay, "WORTH_COMPILING", 100)
    assert worth_compiling(np.array(stamps)) is worth
    assert worth_compiling(np.arange(50), cost=2)
    assert not worth_compiling(np.arange(49), cost=2)


def test_a_command_with_two_efforts_is_refused(whole, tmp_path):
    """Compiled code would look at the first alone."""
    table = RecordedRun.open(whole).table("effort_command")

    def edit(messages):
        for message in messages:
            if message[0] == "/effort_command":
                (effort,) = table.get(message[1], "effort", 1)
                sample = JointSample(message[1], ("trunk", "spare"), (), (), (effort, 0.0))
                message[2] = layout_of(sample).pack(sample)

    run = RecordedRun(copied(whole, tmp_path / "p.mcap", edit, digests=NONE))
    with pytest.raises(
        RecordingError, match=r"/effort_command: 2 values of effort .* 1 are needed"
    ):
        list(replay_controllers(run, driven_controllers(run)))
