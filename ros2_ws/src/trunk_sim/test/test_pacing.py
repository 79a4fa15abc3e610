from __future__ import annotations

from dataclasses import replace

import pytest

from trunk_sim.config import SimulatorConfig
from trunk_sim.pacing import (
    MAX_CATCH_UP,
    LockstepPacing,
    RealTimePacing,
    make_pacing,
    tick_period,
)

H = 1_000_000


class FakeLoop:
    """A plant that only counts."""

    def __init__(self, steps=None):
        self.stamp_ns, self.period_ns, self.steps = 0, H, steps
        self.efforts, self.counts = [], {}
        self.finished, self.failure = False, None

    @property
    def at_end(self):
        return self.steps is not None and self.stamp_ns == self.steps * H

    def advance(self, effort):
        self.efforts.append(effort)
        self.stamp_ns += H

    def finish(self):
        self.finished = True

    def fail(self, reason):
        self.failure = reason

    def participant(self, topic):
        return f"/node ({topic})"

    def held_up_ns(self, topics, wall_ns):
        return self.held_up * wall_ns // 100 if topics else 0

    held_up = 0  # percent

    def count(self, what, number=1):
        assert isinstance(number, int)
        assert number != 0
        self.counts[what] = self.counts.get(what, 0) + number


@pytest.fixture
def real_time():
    loop = FakeLoop()
    pacing = RealTimePacing(loop, command_timeout=0.005)
    pacing.begin(now_ns=1000)
    return loop, pacing


class TestRealTime:
    def test_nothing_happens_before_it_begins(self):
        loop = FakeLoop()
        RealTimePacing(loop, 0.005).tick(10**12)
        assert loop.efforts == []

    def test_each_tick_steps_with_the_latest_command(self, real_time):
        loop, pacing = real_time
        pacing.command(0, 3.0, 1001)
        pacing.tick(1000 + H)
        pacing.command(H, 4.0, 1002 + H)
        pacing.tick(1000 + 2 * H)
        assert loop.efforts == [3.0, 4.0]

    def test_a_late_tick_catches_up_and_is_counted(self, real_time):
        loop, pacing = real_time
        pacing.tick(1000 + 4 * H)
        assert loop.stamp_ns == 4 * H
        assert loop.efforts == [0.0] * 4  # there was no command yet
        assert loop.counts["deadlines missed"] == 3
        assert pacing.worst_late_ns == 3 * H

    @pytest.mark.parametrize(("late_ns", "missed", "steps"), [(H - 1, 0, 1), (H, 1, 2)])
    def test_a_deadline_is_missed_from_one_period_on(self, real_time, late_ns, missed, steps):
        loop, pacing = real_time
        pacing.tick(1000 + H + late_ns)
        assert loop.counts.get("deadlines missed", 0) == missed
        assert loop.stamp_ns == steps * H

    def test_a_plant_far_behind_re_anchors(self, real_time):
        loop, pacing = real_time
        pacing.tick(1000 + (MAX_CATCH_UP + 10) * H)
        assert loop.stamp_ns == H
        pacing.tick(1000 + (MAX_CATCH_UP + 11) * H)
        assert loop.stamp_ns == 2 * H
        # What was given up is given up: from there on the ticks are on time again.
        assert loop.counts["deadlines missed"] == MAX_CATCH_UP + 9
        assert pacing.worst_late_ns == 0

    def test_as_far_behind_as_it_may_be_it_still_catches_up(self, real_time):
        loop, pacing = real_time
        pacing.tick(1000 + (MAX_CATCH_UP + 1) * H)
        assert loop.stamp_ns == (MAX_CATCH_UP + 1) * H

    def test_an_old_command_is_not_used_but_the_next_fresh_one_is(self, real_time):
        loop, pacing = real_time
        pacing.command(0, 3.0, 1001)
        for k in range(1, 8):
            pacing.tick(1000 + k * H)
        assert loop.efforts == [3.0] * 6 + [0.0]  # at 5 ms it is still in use, at 6 ms no longer
        assert loop.counts == {"steps without a fresh command": 1}
        pacing.command(7 * H, 5.0, 1)
        pacing.tick(1000 + 8 * H)
        assert loop.efforts[-1] == 5.0

    def test_before_the_first_command_none_is_missed(self, real_time):
        loop, pacing = real_time
        for k in range(1, 9):
            pacing.tick(1000 + k * H)
        assert (loop.efforts, loop.counts) == ([0.0] * 8, {})

    def test_a_command_after_its_step_is_used_and_counted_as_late(self, real_time):
        loop, pacing = real_time
        pacing.command(0, 3.0, 1001)
        pacing.tick(1000 + H)
        assert "commands late" not in loop.counts
        pacing.tick(1000 + 2 * H)
        pacing.command(H, 4.0, 1002 + 2 * H)
        pacing.tick(1000 + 3 * H)
        assert loop.efforts == [3.0, 3.0, 4.0]
        assert loop.counts["commands late"] == 1

    @pytest.mark.parametrize(
        ("answered", "missed"),
        [
            ([0, 1, 2, 3, 8, 9, 10], 4),
            ([2, 3, 4, 5, 6, 7, 8, 9, 10], 2),
            ([0, 1, 2, 3, 4, 5, 6], 4),
            ([0, 3, 6, 9], 0),
            ([0, 2, 4, 8, 10], 1),
            ([0, 4, 5, 6, 7, 8, 9, 10], 0),  # at first a gap is taken for the controller's rate
            ([0, 5], 1),
            ([0, 4, 6, 8], 1),
        ],
        ids=[
            "a gap",
            "not the first",
            "not the last",
            "a third",
            "half and a gap",
            "first gap",
            "half, not the last",
            "half, not the first",
        ],
    )
    def test_unanswered_states_are_counted(self, answered, missed):
        loop = FakeLoop(steps=10)
        pacing = RealTimePacing(loop, command_timeout=1.0)
        pacing.begin(0)
        for k in range(11):
            if k in answered:
                pacing.command(k * H, 1.0, k * H)
            pacing.tick((k + 1) * H)
        pacing.tick(2_000_000_000)
        assert loop.finished
        assert loop.counts.get("states unanswered", 0) == missed

    def test_a_busy_controller_that_answers_every_other_state_is_not_a_slow_one(self):
        loop = FakeLoop(steps=60)
        pacing = RealTimePacing(loop, command_timeout=1.0)
        pacing.begin(0)
        for k in range(61):
            if k < 4 or k % 2 == 0:
                pacing.command(k * H, 1.0, k * H)
            pacing.tick((k + 1) * H)
        assert loop.counts["states unanswered"] == 28  # 5, 7, ... 59

    @pytest.mark.parametrize("every", [2, 4])
    def test_a_slow_controller_that_takes_over_misses_nothing(self, every):
        loop = FakeLoop(steps=400)
        pacing = RealTimePacing(loop, command_timeout=1.0)
        pacing.begin(0)
        for k in range(401):
            if k < 4 or k % every == 0:
                pacing.command(k * H, 1.0, k * H)
            pacing.tick((k + 1) * H)
        assert loop.counts["states unanswered"] == 0

    @pytest.mark.parametrize("stamp_ns", [-H, 0, H], ids=["older", "same", "from the future"])
    def test_commands_out_of_order_are_counted_and_ignored(self, real_time, stamp_ns):
        loop, pacing = real_time
        pacing.command(0, 3.0, 1001)
        pacing.command(stamp_ns, 9.0, 1002)
        pacing.tick(1000 + H)
        assert loop.efforts == [3.0]
        assert loop.counts["commands out of order"] == 1

    def test_a_pause_takes_no_time(self, real_time):
        loop, pacing = real_time
        pacing.paused = True
        pacing.tick(1000 + 5 * H)
        assert loop.efforts == []
        pacing.begin(1000 + 9 * H)
        pacing.tick(1000 + 10 * H)
        assert loop.stamp_ns == H

    def test_after_a_pause_it_catches_up_from_where_it_was(self, real_time):
        loop, pacing = real_time
        pacing.tick(1000 + 3 * H)
        pacing.begin(1000 + 100 * H)
        pacing.tick(1000 + 104 * H)
        assert loop.stamp_ns == 7 * H

    def test_an_early_tick_is_not_late(self, real_time):
        loop, pacing = real_time
        pacing.tick(1000 + H - 500)
        assert (loop.stamp_ns, pacing.worst_late_ns, loop.counts) == (H, 0, {})

    @pytest.mark.parametrize("answered", [True, False])
    def test_the_last_state_waits_for_its_answer_up_to_the_timeout(self, answered):
        loop = FakeLoop(steps=1)
        pacing = RealTimePacing(loop, 0.005)
        pacing.begin(0)
        pacing.tick(H)
        pacing.tick(2 * H)
        pacing.tick(7 * H)  # 5 ms after the step after the last would have been due
        assert not loop.finished
        if answered:
            pacing.command(H, 1.0, 7 * H)
        pacing.tick(7 * H if answered else 7 * H + 1)
        assert loop.finished


def lockstep(steps=None, windows=None, speed=0.0):
    loop = FakeLoop(steps)
    pacing = LockstepPacing(loop, windows or {"effort_command": 0}, timeout=1.0, speed=speed)
    return loop, pacing


class TestLockstep:
    def test_it_steps_once_for_each_answer(self):
        loop, pacing = lockstep()
        pacing.begin(0)
        for k in range(5):
            pacing.command(k * H, float(k), 1)
        assert loop.efforts == [0.0, 1.0, 2.0, 3.0, 4.0]

    def test_wrong_answers_are_counted_and_ignored(self):
        loop, pacing = lockstep(windows={"effort_command": 0, "disturbance": -H})
        pacing.begin(0)
        pacing.command(-H, 9.0, 1)
        pacing.command(5 * H, 9.0, 1)
        pacing.command(0, 1.0, 1)
        pacing.command(0, 9.0, 1)
        pacing.answered("disturbance", H, 1)
        assert loop.efforts == [1.0]
        assert loop.counts == {
            "late answers ignored": 1,
            "answers to no state ignored": 1,
            "doubled answers ignored": 1,
        }

    def test_who_is_not_awaited_changes_nothing(self):
        loop, pacing = lockstep()
        pacing.begin(0)
        pacing.answered("disturbance", 0, 1)
        assert pacing.silent() == ["effort_command"]
        pacing.command(0, 1.0, 1)
        assert loop.efforts == [1.0]

    def test_answers_before_the_start_count_but_do_not_step(self):
        loop, pacing = lockstep(windows={"effort_command": 0, "disturbance": -H})
        pacing.answered("disturbance", H, 0)
        assert loop.efforts == []
        pacing.begin(1)
        pacing.command(0, 1.0, 2)
        assert loop.efforts == [1.0]

    def test_the_disturbance_answers_for_the_next_state(self):
        loop, pacing = lockstep(windows={"effort_command": 0, "disturbance": -H})
        pacing.begin(0)
        pacing.answered("disturbance", 0, 1)
        pacing.command(0, 1.0, 1)
        assert pacing.silent() == ["disturbance"]
        pacing.answered("disturbance", H, 1)
        assert loop.efforts == [1.0]

    def test_the_recorder_may_lag_by_its_window_but_not_at_the_end(self):
        loop, pacing = lockstep(steps=4, windows={"effort_command": 0, "recorder": 2 * H})
        pacing.answered("recorder", 0, 0)
        pacing.begin(0)
        for k in range(3):
            pacing.command(k * H, 0.0, 1)
        assert loop.stamp_ns == 3 * H  # state 3 may not be left: the recorder is 3 behind
        pacing.command(3 * H, 0.0, 1)
        assert loop.stamp_ns == 3 * H
        pacing.answered("recorder", H, 1)
        assert loop.stamp_ns == 4 * H
        pacing.command(4 * H, 0.0, 1)
        assert not loop.finished
        pacing.answered("recorder", 3 * H, 1)  # within its window, and yet not all that there is
        assert not loop.finished
        pacing.answered("recorder", 4 * H, 1)
        assert loop.finished

    def test_the_last_state_waits_for_the_disturbance_as_any_other(self):
        loop, pacing = lockstep(steps=0, windows={"effort_command": 0, "disturbance": -H})
        pacing.begin(0)
        pacing.command(0, 0.0, 1)
        pacing.answered("disturbance", 0, 1)
        assert not loop.finished
        pacing.answered("disturbance", H, 1)
        assert loop.finished

    def test_silence_ends_the_run_and_the_error_names_the_silent(self):
        loop, pacing = lockstep(windows={"effort_command": 0, "recorder": 5 * H})
        pacing.begin(0)
        pacing.command(0, 1.0, 500_000_000)
        pacing.tick(1_500_000_000)  # as long as the timeout is
        assert loop.failure is None
        pacing.tick(1_600_000_000)
        assert "no answer from /node (effort_command) to the state" in loop.failure
        assert "recorder" not in loop.failure
        assert "t = 0.001 s" in loop.failure

    @pytest.mark.parametrize(("held_up", "ticks"), [(0, 101), (50, 167), (100, None)])
    def test_time_in_which_a_participant_was_held_up_does_not_count(self, held_up, ticks):
        loop, pacing = lockstep()
        loop.held_up = held_up
        pacing.begin(0)
        failed = None
        for tick in range(1, 1000):
            pacing.tick(tick * 10_000_000)  # 100 of them are the timeout
            if loop.failure:
                failed = tick
                break
        assert failed == ticks

    def test_an_answer_begins_the_wait_anew(self):
        loop, pacing = lockstep()
        pacing.begin(0)
        for tick in range(1, 1000):
            pacing.tick(tick * 10_000_000)
            if tick % 90 == 0:
                pacing.command(loop.stamp_ns, 0.0, tick * 10_000_000)
        assert loop.failure is None
        assert len(loop.efforts) == 11

    @pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
    def test_the_pace_delays_the_next_state(self, speed):
        loop, pacing = lockstep(speed=speed)
        pacing.begin(0)
        pacing.command(0, 1.0, 100)
        assert loop.efforts == []
        pacing.tick(round(H / speed) - 1)
        assert loop.efforts == []
        pacing.tick(round(H / speed))
        assert loop.efforts == [1.0]

    def test_without_a_controller_no_torque_acts(self):
        loop, pacing = lockstep(windows={"disturbance": -H})
        pacing.begin(0)
        pacing.answered("disturbance", H, 1)
        assert loop.efforts == [0.0]

    def test_a_pause_does_not_count_towards_the_timeout(self):
        loop, pacing = lockstep()
        pacing.begin(0)
        pacing.paused = True
        pacing.command(0, 1.0, 1)
        pacing.tick(10**10)
        assert (loop.efforts, loop.failure) == ([], None)
        pacing.begin(10**10)
        assert loop.efforts == [1.0]


EVERYBODY = ("effort_command", "disturbance", "recorder")


class TestFromAConfiguration:
    def test_real_time_uses_a_command_up_to_its_timeout(self):
        loop = FakeLoop()
        pacing = make_pacing(loop, SimulatorConfig(command_timeout=0.002))
        pacing.begin(0)
        pacing.command(0, 3.0, 0)
        for k in range(1, 5):
            pacing.tick(k * H)
        assert loop.efforts == [3.0, 3.0, 3.0, 0.0]

    def test_lockstep_waits_for_whom_it_is_told_with_their_windows(self):
        loop = FakeLoop()
        config = SimulatorConfig(
            update_rate=1000.0, lockstep=True, wait_for=EVERYBODY, lockstep_window=3
        )
        pacing = make_pacing(loop, config)
        pacing.begin(0)
        assert pacing.silent() == ["effort_command", "disturbance"]
        pacing.command(0, 0.0, 1)
        assert pacing.silent() == ["disturbance"]
        pacing.answered("disturbance", 9 * H, 1)
        pacing.command(H, 0.0, 1)
        assert pacing.silent() == ["effort_command"]
        pacing.command(2 * H, 0.0, 1)
        assert pacing.silent() == ["effort_command", "recorder"]  # at state 3 it wrote none yet
        alone = make_pacing(FakeLoop(), replace(config, wait_for=("effort_command",)))
        alone.begin(0)
        assert alone.silent() == ["effort_command"]

    def test_lockstep_has_its_timeout_and_its_pace(self):
        loop = FakeLoop()
        config = SimulatorConfig(
            lockstep=True, wait_for=("effort_command",), lockstep_timeout=2.0, lockstep_speed=4.0
        )
        pacing = make_pacing(loop, config)
        pacing.begin(0)
        pacing.tick(2_000_000_000)
        assert loop.failure is None
        pacing.tick(2_000_000_001)
        assert "lockstep.timeout = 2 s" in loop.failure
        pacing.begin(0)
        pacing.command(0, 1.0, 1)
        assert loop.efforts == []
        pacing.tick(H // 4)
        assert loop.efforts == [1.0]

    @pytest.mark.parametrize(
        ("mode", "period"),
        [
            ({}, 0.02),
            ({"lockstep": True}, 0.05),
            ({"lockstep": True, "lockstep_speed": 4.0}, 0.005),
            ({"lockstep": True, "lockstep_speed": 0.1}, 0.05),
        ],
        ids=["real time", "lock-step", "fast pace", "slow pace"],
    )
    def test_it_is_called_once_a_period_and_in_lockstep_at_least_every_50_ms(self, mode, period):
        waits = {"wait_for": ("effort_command",)} if mode else {}
        config = SimulatorConfig(update_rate=50.0, **mode, **waits)
        assert tick_period(config) == pytest.approx(period)
