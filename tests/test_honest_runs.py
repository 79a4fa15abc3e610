"""What `trunk verify` once accused wrongly, each as a separate run or record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trunk_control.controller import Controller
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change, Timeline
from trunk_experiments.plans.turns import Swap
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay, stretches
from trunk_experiments.replay.real_time import PossibleDisturbances
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.reader import Recording
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
    possible.passed(0, 0)
    ((since_ns, acting),) = possible.at(3 * H, timeout_ns=3 * H)
    assert (since_ns, acting) == (0, Disturbance(trunk_torque=1.0))
    possible.chosen(since_ns)
    now = dict(possible.at(4 * H, timeout_ns=3 * H))
    assert now == {H: Disturbance(trunk_torque=1.0), 0: Disturbance()}


def test_no_disturbance_is_followed_by_an_older_one():
    possible = PossibleDisturbances(Told([1.0, 2.0, 2.0, 1.0]))
    assert list(dict(possible.at(2 * H, timeout_ns=10 * H))) == [H, 0, -1]
    possible.passed(2 * H, 2 * H)
    assert list(dict(possible.at(3 * H, timeout_ns=10 * H))) == [3 * H, H]


def test_a_pulse_may_act_after_its_end_where_messages_are_late():
    """As long as nothing disturbs, the message from before a pulse may be in force, or the one after it."""
    told = Told([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    late = PossibleDisturbances(told)
    late.passed(0, H)
    late.passed(4 * H, 4 * H)
    assert list(dict(late.at(5 * H, timeout_ns=10 * H))) == [4 * H, 2 * H, 0]
    in_time = PossibleDisturbances(told)
    in_time.passed(0, 4 * H)
    assert list(dict(in_time.at(5 * H, timeout_ns=10 * H))) == [4 * H]


@pytest.mark.slow
def test_in_a_long_real_time_run_a_pulse_may_begin_and_end_late(tmp_path, monkeypatch):
    """Such runs are skipped over by compiled code, which takes each state's own message."""
    monkeypatch.setattr(replay, "WORTH_COMPILING", 1000)
    if not stretches.available():
        pytest.skip("numba: in requirements/runtime.txt")
    pulse = ("channel=trunk_effort", "start_times=[0.5]", "duration=0.25")
    settings = [f"disturbance.pulse.{one}" for one in pulse]
    plan = make_plan("fig6", "pid", settings=settings, everywhere={"duration": 5.0})
    record_offline(plan, tmp_path / "run.mcap")

    def two_steps_late(messages):
        told = [m for m in messages if m[0] == "/disturbance"]
        for message, later in zip(told, told[2:], strict=False):
            message[2] = message[2][:12] + later[2][12:]  # its own stamp with later values

    late = copied(
        tmp_path / "run.mcap",
        tmp_path / "late.mcap",
        two_steps_late,
        NONE,
        provenance={"mode": "real_time"},
    )
    checked = list(PlantReplay(RecordedRun(late)))
    assert [d for one in checked for d in one.found] == []
    assert max(one.steps for one in checked) > 100
