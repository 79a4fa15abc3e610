"""What `trunk verify` once accused wrongly, each as a separate run or record."""

from dataclasses import replace

import numpy as np
import pytest

from trunk_control.controller import Controller
from trunk_core import topics
from trunk_core.topics import Event
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun, late_steps
from trunk_recording.reader import Recording
from trunk_runs import engine
from trunk_runs.loop import states_of
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import Swap, make_plan
from trunk_runs.timeline import Change, Timeline

from .real_time import late_inputs, record_real_time

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
    (fell,) = (e for e in Recording.open(path).events("/run/events") if e.message == Event.FELL)
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


@pytest.mark.parametrize(("word", "pending"), [(None, True), (Event.CLEANED_UP, False)])
def test_a_controller_that_was_cleaned_up_has_seen_nothing(word, pending):
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
    assert controller.state.transfer.pending == pending


@pytest.mark.parametrize("late", [0, 2])
def test_a_reset_stops_the_drive_too(tmp_path, late):
    """In real time too, the torque over a step follows from the one before it, which a reset sets to 0."""
    plan = make_plan(
        "fig6",
        "pid",
        settings=["simulator.actuator.time_constant=0.05"],
        everywhere={"duration": 0.3, "update_rate": 200.0},
    )
    plan = replace(plan, changes={"simulator": [Change(10 * H, None, Event.RESET)]})
    recording = record_real_time(plan, tmp_path / "run.mcap", late_inputs(plan, commands=late))
    truth = RecordedRun(recording).table(topics.GROUND_TRUTH)
    assert abs(truth.get(10 * H, "effort")[1]) > 1.0
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons


@pytest.mark.parametrize("age", [40, 41])
def test_a_command_may_be_too_old_where_later_ones_have_not_come(tmp_path, age):
    """Nothing is then in force, and the simulator's rule says when: after 0.2 s, and no step before."""
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.5, "update_rate": 200.0})
    inputs = late_inputs(plan, np.where(np.arange(101) < 60, 0, np.arange(101) - 59))
    dropped = np.arange(101) * 5_000_000 - inputs.command_ns >= age * 5_000_000
    plan_inputs = replace(inputs, command_ns=np.where(dropped, -1, inputs.command_ns))
    verdict = verify(record_real_time(plan, tmp_path / "run.mcap", plan_inputs))
    assert plan.simulator.command_timeout == 0.2
    assert (verdict.exit_code == VERIFIED) == (age == 41), verdict.reasons


FORCE = ("disturbance.sine.amplitude=1.0",)  # of the hip
OFFSET = ("disturbance.sine.amplitude=0.001", "disturbance.sine.channel=trunk_position")


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("pulse_length", "more", "compiled"),
    [
        (0.25, (), False),
        (0.25, (), True),
        (0.001, ("simulator.hip.mode=prescribed", *FORCE), False),
        (0.001, ("simulator.sensor.position_resolution=0.1", *OFFSET), False),
    ],
    ids=["alone", "compiled", "with a force without effect", "with an offset that rounding hides"],
)
def test_in_a_long_real_time_run_a_pulse_may_begin_and_end_late(
    pulse_length, more, compiled, tmp_path, monkeypatch
):
    """Whether compiled code judges it or not."""
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: compiled)
    pulse = ("channel=trunk_effort", "start_times=[0.5]", f"duration={pulse_length}")
    settings = [*(f"disturbance.pulse.{one}" for one in pulse), *more]
    plan = make_plan("fig6", "pid", settings=settings, everywhere={"duration": 0.8})
    inputs = late_inputs(plan, disturbances=np.full(states_of(plan), 2))
    recording = record_real_time(plan, tmp_path / "run.mcap", inputs)
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert late_steps(RecordedRun(recording)).steps == 799
