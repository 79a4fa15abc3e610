"""What `trunk verify` once accused wrongly, each as a separate run or record."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trunk_experiments.replay.attributable import shared_from_ns
from trunk_experiments.replay.real_time import PossibleDisturbances, replay_torques
from trunk_experiments.replay.replay import acting_at
from trunk_experiments.replay.replay_plant import PlantReplay

from trunk_control.controller import Controller
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change, Timeline
from trunk_experiments.plans.turns import Swap
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay, stretches
from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.reader import Recording
from trunk_sim.disturbance_feed import DisturbanceFeed
from trunk_sim.disturbances import Disturbance

from .edited import NONE, copied

H = 5_000_000  # ns


def verdict(plan, path):
    record_offline(plan, path)
    return verify(Recording.open(path))


def test_a_fall_names_the_limit_in_force(tmp_path):
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.3, "update_rate": 200.0})
    plan = replace(
        plan,
        simulator=replace(plan.simulator, fall_angle=3.0, initial_position=(0.0, 1.0)),
        changes={"simulator": [Change(10 * H, {"fall.angle": 0.01})]},
    )
    path = tmp_path / "fall.mcap"
    assert verdict(plan, path).exit_code == VERIFIED
    (fell,) = (e for e in Recording.open(path).events() if e.message == Event.FELL)
    assert fell.values["limit"] == "0.01"


def test_two_turns_may_fall_between_two_states(tmp_path):
    plan = make_plan(
        "fig6",
        "pid",
        everywhere={"duration": 0.3, "update_rate": 200.0},
        swaps=[Swap(0.1011, "fuzzy_pid"), Swap(0.1012, "pid"), Swap(0.2, "fuzzy_pid")],
    )
    assert verdict(plan, tmp_path / "turns.mcap").exit_code == VERIFIED


def test_changes_after_the_end_have_no_effect(tmp_path):
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.1, "update_rate": 200.0})
    plan = replace(plan, changes={"pid": [Change(H * 1000, None)]})
    assert verdict(plan, tmp_path / "late.mcap").exit_code == VERIFIED


@pytest.mark.parametrize(("word", "takes_over"), [(None, True), (Event.CLEANED_UP, False)])
def test_a_controller_that_was_cleaned_up_has_seen_nothing(word, takes_over):
    config = make_plan("fig6", "pid").controllers["pid"]
    changes = [Change(H, None, Event.DEACTIVATED)]
    changes += [Change(H, None, word)] if word else []
    # It joins the run under way just before the state at 3 H.
    changes += [Change(3 * H - 1, None, Event.ACTIVATED)]
    controller = Controller(config)
    timeline = Timeline(config, changes)
    for k in range(2):
        timeline.advance(k * H, controller)
        controller.update(k * H, 0.5, 0.0)
    timeline.advance(3 * H, controller)
    assert controller.active
    assert controller.takes_over == takes_over


def in_real_time(path, edit=lambda messages: None):
    """Return a copy of a run, with its messages edited, as one that ran in real time."""
    copy = path.with_suffix(".real_time.mcap")
    return RecordedRun(copied(path, copy, edit, NONE, provenance={"mode": "real_time"}))


class Told:
    """A topic's disturbances of the trunk's torque, one for each step."""

    topic = "disturbance"
    names = ("hip", "trunk")

    def __init__(self, torques):
        self.stamp_ns = np.arange(len(torques)) * H
        self.rows = {k * H: k for k in range(len(torques))}
        self._values = {
            "effort": np.array([[0.0, torque] for torque in torques]),
            "position": np.zeros((len(torques), 2)),
        }

    def __contains__(self, stamp_ns):
        return stamp_ns in self.rows

    def values(self, quantity):
        return self._values[quantity]

    def get(self, stamp_ns, quantity, count=None):
        return self._values[quantity][self.rows[stamp_ns]].tolist()


def test_of_equal_disturbances_an_old_one_may_run_out():
    """Nobody knows which of four equal messages was in force: it may be too old one step later."""
    possible = PossibleDisturbances(Told([1.0, 1.0, 1.0, 1.0, 1.0]))
    possible.passed(0, 0, 3 * H)
    ((since_ns, acting),) = possible.at(3 * H, timeout_ns=3 * H)
    assert (since_ns, acting) == (0, Disturbance(trunk_torque=1.0))
    possible.chosen(since_ns)
    now = dict(possible.at(4 * H, timeout_ns=3 * H))
    assert now == {H: Disturbance(trunk_torque=1.0), 0: Disturbance()}


def test_no_disturbance_is_followed_by_an_older_one():
    possible = PossibleDisturbances(Told([1.0, 2.0, 2.0, 1.0]))
    assert list(dict(possible.at(2 * H, timeout_ns=10 * H))) == [H, 0, -1]
    possible.passed(2 * H, 2 * H, 10 * H)
    assert list(dict(possible.at(3 * H, timeout_ns=10 * H))) == [3 * H, H]


def test_a_pulse_may_act_after_its_end_where_messages_are_late():
    """As long as nothing disturbs, the message from before a pulse may be in force, or the one after it."""
    told = Told([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    late = PossibleDisturbances(told)
    late.passed(0, H, 10 * H)
    late.passed(4 * H, 4 * H, 10 * H)
    assert list(dict(late.at(5 * H, timeout_ns=10 * H))) == [4 * H, 2 * H, 0, -1]
    in_time = PossibleDisturbances(told)
    in_time.passed(0, 4 * H, 10 * H)
    assert list(dict(in_time.at(5 * H, timeout_ns=10 * H))) == [4 * H]


def test_where_nothing_acts_a_message_may_be_too_old():
    """The pulse ran out before the rest of it arrived, and not because its end had arrived."""
    possible = PossibleDisturbances(Told([1.0, 1.0, 1.0, 1.0, 0.0, 0.0]))
    possible.passed(0, 0, 3 * H)  # the first message arrived in time, none since
    possible.passed(4 * H, 4 * H, 3 * H)  # that of its stamp, or none: the first one is too old
    assert dict(possible.at(5 * H, timeout_ns=3 * H)) == {
        4 * H: Disturbance(),
        2 * H: Disturbance(trunk_torque=1.0),
        0: Disturbance(),
    }


def effect(acting: Disturbance) -> tuple[float, ...]:
    """Return what the record shows of a disturbance: rounding hides small differences."""
    return tuple(round(value, 9) for value in (acting.trunk_torque, acting.trunk_offset))


@settings(max_examples=500)
@given(
    said=st.lists(st.sampled_from([0.0, 1.0, 1.0 + 2**-50, 2.0]), min_size=1, max_size=20),
    late=st.lists(st.sampled_from([0, 2, 5]), min_size=20, max_size=20),
    timeout=st.integers(0, 3),
    compiled=st.lists(st.sampled_from([True, True, False]), min_size=20, max_size=20),
)
def test_what_acted_in_a_simulator_is_always_possible(said, late, timeout, compiled):
    """However late the messages are, and whether compiled code passes over a state or not."""
    told = Told(said)
    told.values("effort")[:, 0] = np.arange(len(said))  # a force that has no effect
    possible, feed, arrived = PossibleDisturbances(told), DisturbanceFeed(H), 0
    for k in range(len(said)):
        while arrived < len(said) and arrived + late[arrived] <= k:
            feed.take(arrived * H, acting_at(told, arrived * H), k * H)
            arrived += 1
        feed.advance(k * H, timeout * H)
        acted = effect(feed.acting)
        if compiled[k] and effect(acting_at(told, k * H)) == acted:
            possible.passed(k * H, k * H, timeout * H, no_effect=[0])
            continue
        fitting = [since for since, one in possible.at(k * H, timeout * H) if effect(one) == acted]
        assert fitting
        possible.chosen(min(fitting))


def test_a_command_may_be_too_old_where_later_ones_are_zero(tmp_path):
    """The torque was 0 because the controller was late, not because a later command of 0 had arrived."""
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.5, "update_rate": 200.0})
    record_offline(plan, tmp_path / "run.mcap")
    timeout = int(plan.simulator.command_timeout * 200)
    commands = [1.0] * 10 + [0.0] * 91  # by state
    # In force at each state: the first one until it is too old, then the last but one of those of 1 N m.
    acted = [1.0] * (timeout + 1) + [0.0] * 4 + [1.0] * 3 + [0.0] * 93

    def edit(messages):
        for topic, values in (("/effort_command", commands), ("/ground_truth/joint_states", acted)):
            first = topic != "/effort_command"  # a state has the torque over the step before it
            told = [message for message in messages if message[0] == topic]
            for k, message in enumerate(told):
                value = (0.0 if k == 0 else values[k - 1]) if first else values[k]
                message[2] = message[2][:-8] + struct.pack("<d", value)

    run = in_real_time(tmp_path / "run.mcap", edit)
    assert run.table(topics.EFFORT_COMMAND).get(9 * H, "effort") == [1.0]
    checked = list(replay_torques(run))
    assert len(checked) == 100
    assert [d for one in checked for d in one.found] == []


def test_disturbances_that_go_backwards_come_from_two_nodes(tmp_path):
    """One was killed before the recorder had met it; what it sent at the same stamps is not on record."""
    plan = make_plan("demo", "pid", everywhere={"duration": 0.3})
    record_offline(plan, tmp_path / "run.mcap")

    def third_last(messages):
        told = [message for message in messages if message[0] == "/disturbance"]
        messages.remove(told[2])
        messages.append(told[2])

    cut = copied(tmp_path / "run.mcap", tmp_path / "cut.mcap", third_last, NONE, end=False)
    assert shared_from_ns(RecordedRun(cut)) == 2 * H


def test_a_reset_stops_the_drive_too(tmp_path):
    """In real time the torque over a step follows from the one before it, which a reset sets to 0."""
    plan = make_plan(
        "fig6",
        "pid",
        settings=["simulator.actuator.time_constant=0.05"],
        everywhere={"duration": 0.3, "update_rate": 200.0},
    )
    plan = replace(plan, changes={"simulator": [Change(10 * H, None)]})
    record_offline(plan, tmp_path / "run.mcap")
    run = in_real_time(tmp_path / "run.mcap")
    assert abs(run.table(topics.GROUND_TRUTH).get(10 * H, "effort")[1]) > 1.0
    checked = list(replay_torques(run))
    assert len(checked) == 60
    assert [d for one in checked for d in one.found] == []


FORCE = ("disturbance.sine.amplitude=1.0",)  # of the hip
OFFSET = ("disturbance.sine.amplitude=0.001", "disturbance.sine.channel=trunk_position")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pulse_length", "more"),
    [
        (0.25, ()),
        (0.001, ("simulator.hip.mode=prescribed", *FORCE)),
        (0.001, ("simulator.sensor.position_resolution=0.1", *OFFSET)),
    ],
    ids=["alone", "with a force without effect", "with an offset that rounding hides"],
)
def test_in_a_long_real_time_run_a_pulse_may_begin_and_end_late(
    pulse_length, more, tmp_path, monkeypatch
):
    """Such runs are skipped over by compiled code, which takes each state's own message."""
    monkeypatch.setattr(replay, "WORTH_COMPILING", 1000)
    if not stretches.available():
        pytest.skip("numba: in requirements/runtime.txt")
    pulse = ("channel=trunk_effort", "start_times=[0.5]", f"duration={pulse_length}")
    told = [*(f"disturbance.pulse.{one}" for one in pulse), *more]
    plan = make_plan("fig6", "pid", settings=told, everywhere={"duration": 5.0})
    record_offline(plan, tmp_path / "run.mcap")

    def two_steps_late(messages):
        told = [m for m in messages if m[0] == "/disturbance"]
        for message, later in zip(told, told[2:], strict=False):
            message[2] = message[2][:12] + later[2][12:]  # its own stamp with later values

    checked = list(PlantReplay(in_real_time(tmp_path / "run.mcap", two_steps_late)))
    assert [d for one in checked for d in one.found] == []
    assert max(one.steps for one in checked) > 100
