"""Changes during a run take effect in order, from the first state after their stamp."""

from dataclasses import replace

from trunk_control.controller import Controller
from trunk_control.pid import PidConfig
from trunk_core.topics import Event
from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.timeline import Change, Timeline

from ...trunk_runs.test.stepwise import steps


def test_the_later_of_two_changes_between_two_states_holds():
    changes = [
        Change(5, {"gains.p": 2.0}),
        Change(0, {"gains.p": 9.0}),
        Change(5, {"gains.p": 3.0}),
    ]
    timeline = Timeline(PidConfig(), changes)
    controller = Controller(timeline.config)
    assert timeline.advance(5, controller)
    assert controller.config.p == 9.0
    assert timeline.advance(6, controller)
    assert controller.config.p == timeline.config.p == 3.0
    assert not timeline.advance(7, controller)


def test_the_last_of_several_turns_between_two_states_holds():
    turns = [Change(5, None, what) for what in (Event.DEACTIVATED, Event.ACTIVATED, Event.RESET)]
    timeline = Timeline(PidConfig(), turns, lambda stamp_ns: 0.1)
    controller = Controller(timeline.config)
    timeline.advance(6, controller)
    assert controller.active
    assert not controller.state.transfer.pending  # the reset came after


def test_a_change_before_the_first_state_acts_on_it(tmp_path):
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.1})
    changes = {"simulator": [Change(-1, {"sensor.position_bias": 0.125})]}
    changed = replace(plan, changes=changes)
    first, biased = next(steps(plan)), next(steps(changed))
    assert biased.measured.position[1] - first.measured.position[1] == 0.125
    path = tmp_path / "run.mcap"
    record_offline(changed, path)
    assert verify(Recording.open(path)).exit_code == VERIFIED
