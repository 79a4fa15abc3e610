"""Steps that follow the answers: who is awaited, which answers count, how silence ends a run."""

import pytest

from trunk_sim.pacing import LockstepPacing

from .counting_loop import CountingLoop, H


def lockstep(steps=None, windows=None, speed=0.0):
    loop = CountingLoop(steps)
    pacing = LockstepPacing(loop, windows or {"effort_command": 0}, timeout=1.0, speed=speed)
    return loop, pacing


def test_it_steps_once_for_each_answer():
    loop, pacing = lockstep()
    pacing.begin(0)
    for k in range(5):
        pacing.command(k * H, float(k), 1)
    assert loop.efforts == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_wrong_answers_are_counted_and_ignored():
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


def test_an_answer_that_is_not_awaited_changes_nothing():
    loop, pacing = lockstep()
    pacing.begin(0)
    pacing.answered("disturbance", 0, 1)
    assert pacing.silent() == ["effort_command"]
    pacing.command(0, 1.0, 1)
    assert loop.efforts == [1.0]


def test_answers_before_the_start_count_but_do_not_step():
    loop, pacing = lockstep(windows={"effort_command": 0, "disturbance": -H})
    pacing.answered("disturbance", H, 0)
    assert loop.efforts == []
    pacing.begin(1)
    pacing.command(0, 1.0, 2)
    assert loop.efforts == [1.0]


def test_the_disturbance_answers_for_the_next_state():
    loop, pacing = lockstep(windows={"effort_command": 0, "disturbance": -H})
    pacing.begin(0)
    pacing.answered("disturbance", 0, 1)
    pacing.command(0, 1.0, 1)
    assert pacing.silent() == ["disturbance"]
    pacing.answered("disturbance", H, 1)
    assert loop.efforts == [1.0]


def test_a_window_is_narrowed_but_never_widened():
    loop, pacing = lockstep(windows={"effort_command": 0, "recorder": 3 * H})
    pacing.narrow("recorder", H)
    pacing.narrow("recorder", 2 * H)
    pacing.narrow("disturbance", H)  # nobody waits for it
    pacing.begin(0)
    for k in range(5):
        pacing.command(k * H, 1.0, 1)
    assert pacing.silent() == ["recorder"]
    assert loop.stamp_ns == H


def test_the_recorder_may_lag_by_its_window_but_not_at_the_end():
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


def test_the_last_state_waits_for_the_disturbance_like_any_other():
    loop, pacing = lockstep(steps=0, windows={"effort_command": 0, "disturbance": -H})
    pacing.begin(0)
    pacing.command(0, 0.0, 1)
    pacing.answered("disturbance", 0, 1)
    assert not loop.finished
    pacing.answered("disturbance", H, 1)
    assert loop.finished


def test_silence_ends_the_run_and_the_error_names_the_silent():
    loop, pacing = lockstep(windows={"effort_command": 0, "recorder": 5 * H})
    pacing.begin(0)
    pacing.command(0, 1.0, 500_000_000)
    pacing.tick(1_500_000_000)  # as long as the timeout is
    assert loop.failure is None
    pacing.tick(1_600_000_000)
    assert "no answer from /node (effort_command) to the state" in loop.failure
    assert "recorder" not in loop.failure
    assert "t = 0.001 s" in loop.failure


def test_a_patient_machine_waits_longer(monkeypatch):
    monkeypatch.setenv("TRUNK_PATIENCE", "3")
    loop, pacing = lockstep()
    pacing.begin(0)
    pacing.tick(3_000_000_000)  # the timeout is 1 s
    assert loop.failure is None
    pacing.tick(3_000_000_001)
    assert "lockstep.timeout = 1 s" in loop.failure


def test_an_answer_restarts_the_wait():
    loop, pacing = lockstep()
    pacing.begin(0)
    for tick in range(1, 1000):
        pacing.tick(tick * 10_000_000)
        if tick % 90 == 0:
            pacing.command(loop.stamp_ns, 0.0, tick * 10_000_000)
    assert loop.failure is None
    assert len(loop.efforts) == 11


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_the_pace_delays_the_next_state(speed):
    loop, pacing = lockstep(speed=speed)
    pacing.begin(0)
    pacing.command(0, 1.0, 100)
    assert loop.efforts == []
    pacing.tick(round(H / speed) - 1)
    assert loop.efforts == []
    pacing.tick(round(H / speed))
    assert loop.efforts == [1.0]


def test_without_a_controller_no_torque_acts():
    loop, pacing = lockstep(windows={"disturbance": -H})
    pacing.begin(0)
    pacing.answered("disturbance", H, 1)
    assert loop.efforts == [0.0]


def test_a_pause_does_not_count_towards_the_timeout():
    loop, pacing = lockstep()
    pacing.begin(0)
    pacing.paused = True
    pacing.command(0, 1.0, 1)
    pacing.tick(10**10)
    assert (loop.efforts, loop.failure) == ([], None)
    pacing.begin(10**10)
    assert loop.efforts == [1.0]


def test_the_speed_changes_during_the_run():
    loop, pacing = lockstep(speed=1.0)
    pacing.begin(0)

    def answered_at(now_ns):
        pacing.command(loop.stamp_ns, 1.0, now_ns)
        pacing.tick(now_ns)
        return loop.stamp_ns

    before = loop.stamp_ns
    assert answered_at(loop.period_ns // 2) == before  # too early
    pacing.set_speed(10.0, loop.period_ns // 2)
    pacing.tick(loop.period_ns // 2)
    assert loop.stamp_ns == before  # from now on, a tenth of a period later
    pacing.tick(loop.period_ns // 2 + loop.period_ns // 10)
    assert loop.stamp_ns == before + loop.period_ns


@pytest.mark.parametrize(
    ("stamp_ns", "fault"),
    [
        (1_795_000_000 * 10**9, "they carry the wall clock's stamps"),
        (H + 1, "they carry stamps of no state"),
    ],
)
def test_a_stamp_that_no_state_can_have_ends_the_run(stamp_ns, fault):
    loop, pacing = lockstep()
    pacing.begin(0)
    pacing.command(stamp_ns, 1.0, 1)
    assert loop.efforts == []
    assert fault in loop.failure
    assert "copy header.stamp of the state" in loop.failure


def test_silence_names_commands_without_a_stamp():
    loop, pacing = lockstep()
    pacing.begin(0)
    pacing.command(0, 1.0, 1)
    pacing.command(0, 1.0, 1)
    pacing.tick(2 * 10**9)
    assert loop.efforts == [1.0]
    assert "1 commands came without a stamp: copy header.stamp" in loop.failure
