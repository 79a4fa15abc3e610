"""Steps that follow the wall clock: which command acts, what is late, what is counted."""

import pytest

from trunk_msgs_util.source import ARRIVAL
from trunk_sim.pacing import MAX_CATCH_UP, RealTimePacing

from .counting_loop import CountingLoop, H


def give(pacing, stamp_ns, effort, now_ns):
    """Give a command of a controller of ours."""
    pacing.command(stamp_ns, effort, now_ns, "pid@process")


@pytest.fixture
def real_time():
    loop = CountingLoop()
    pacing = RealTimePacing(loop, command_timeout=0.005)
    pacing.begin(now_ns=1000)
    return loop, pacing


def test_nothing_happens_before_it_begins():
    loop = CountingLoop()
    RealTimePacing(loop, 0.005).tick(10**12)
    assert loop.efforts == []


def test_each_tick_steps_with_the_latest_command(real_time):
    loop, pacing = real_time
    give(pacing, 0, 3.0, 1001)
    pacing.tick(1000 + H)
    give(pacing, H, 4.0, 1002 + H)
    pacing.tick(1000 + 2 * H)
    assert loop.efforts == [3.0, 4.0]


def test_a_late_tick_catches_up_and_is_counted(real_time):
    loop, pacing = real_time
    pacing.tick(1000 + 4 * H)
    assert loop.stamp_ns == 4 * H
    assert loop.efforts == [0.0] * 4  # there was no command yet
    assert loop.counts["deadlines missed"] == 3
    assert pacing.worst_late_ns == 3 * H


@pytest.mark.parametrize(("late_ns", "missed", "steps"), [(H - 1, 0, 1), (H, 1, 2)])
def test_a_deadline_is_missed_from_one_period_on(real_time, late_ns, missed, steps):
    loop, pacing = real_time
    pacing.tick(1000 + H + late_ns)
    assert loop.counts.get("deadlines missed", 0) == missed
    assert loop.stamp_ns == steps * H


def test_a_plant_far_behind_re_anchors(real_time):
    loop, pacing = real_time
    pacing.tick(1000 + (MAX_CATCH_UP + 10) * H)
    assert loop.stamp_ns == H
    pacing.tick(1000 + (MAX_CATCH_UP + 11) * H)
    assert loop.stamp_ns == 2 * H
    # What was given up is given up: from there on the ticks are on time again.
    assert loop.counts["deadlines missed"] == MAX_CATCH_UP + 9
    assert pacing.worst_late_ns == 0


def test_as_far_behind_as_it_may_be_it_still_catches_up(real_time):
    loop, pacing = real_time
    pacing.tick(1000 + (MAX_CATCH_UP + 1) * H)
    assert loop.stamp_ns == (MAX_CATCH_UP + 1) * H


def test_an_old_command_is_not_used_but_the_next_fresh_one_is(real_time):
    loop, pacing = real_time
    give(pacing, 0, 3.0, 1001)
    for k in range(1, 8):
        pacing.tick(1000 + k * H)
    assert loop.efforts == [3.0] * 6 + [0.0]  # at 5 ms it is still in use, at 6 ms no longer
    assert loop.counts == {"steps without a fresh command": 1}
    give(pacing, 7 * H, 5.0, 1)
    pacing.tick(1000 + 8 * H)
    assert loop.efforts[-1] == 5.0


def test_before_the_first_command_none_is_missed(real_time):
    loop, pacing = real_time
    for k in range(1, 9):
        pacing.tick(1000 + k * H)
    assert (loop.efforts, loop.counts) == ([0.0] * 8, {})


def test_a_command_after_its_step_is_used_and_counted_as_late(real_time):
    loop, pacing = real_time
    give(pacing, 0, 3.0, 1001)
    pacing.tick(1000 + H)
    assert "commands late" not in loop.counts
    pacing.tick(1000 + 2 * H)
    give(pacing, H, 4.0, 1002 + 2 * H)
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
def test_unanswered_states_are_counted(answered, missed):
    loop = CountingLoop(steps=10)
    pacing = RealTimePacing(loop, command_timeout=1.0)
    pacing.begin(0)
    for k in range(11):
        if k in answered:
            give(pacing, k * H, 1.0, k * H)
        pacing.tick((k + 1) * H)
    pacing.tick(2_000_000_000)
    assert loop.finished
    assert loop.counts.get("states unanswered", 0) == missed


def test_a_busy_controller_that_answers_every_other_state_is_not_a_slow_one():
    loop = CountingLoop(steps=60)
    pacing = RealTimePacing(loop, command_timeout=1.0)
    pacing.begin(0)
    for k in range(61):
        if k < 4 or k % 2 == 0:
            give(pacing, k * H, 1.0, k * H)
        pacing.tick((k + 1) * H)
    assert loop.counts["states unanswered"] == 28  # 5, 7, ... 59


@pytest.mark.parametrize("every", [2, 4])
def test_a_slow_controller_that_takes_over_misses_nothing(every):
    loop = CountingLoop(steps=400)
    pacing = RealTimePacing(loop, command_timeout=1.0)
    pacing.begin(0)
    for k in range(401):
        if k < 4 or k % every == 0:
            give(pacing, k * H, 1.0, k * H)
        pacing.tick((k + 1) * H)
    assert loop.counts["states unanswered"] == 0


@pytest.mark.parametrize("stamp_ns", [-H, 0, H], ids=["older", "same", "from the future"])
def test_commands_out_of_order_are_counted_and_ignored(real_time, stamp_ns):
    loop, pacing = real_time
    give(pacing, 0, 3.0, 1001)
    give(pacing, stamp_ns, 9.0, 1002)
    pacing.tick(1000 + H)
    assert loop.efforts == [3.0]
    assert loop.counts["commands out of order"] == 1


def test_a_pause_takes_no_time(real_time):
    loop, pacing = real_time
    pacing.paused = True
    pacing.tick(1000 + 5 * H)
    assert loop.efforts == []
    pacing.begin(1000 + 9 * H)
    pacing.tick(1000 + 10 * H)
    assert loop.stamp_ns == H


def test_after_a_pause_it_catches_up_from_where_it_was(real_time):
    loop, pacing = real_time
    pacing.tick(1000 + 3 * H)
    pacing.begin(1000 + 100 * H)
    pacing.tick(1000 + 104 * H)
    assert loop.stamp_ns == 7 * H


def test_an_early_tick_is_not_late(real_time):
    loop, pacing = real_time
    pacing.tick(1000 + H - 500)
    assert (loop.stamp_ns, pacing.worst_late_ns, loop.counts) == (H, 0, {})


@pytest.mark.parametrize("answered", [True, False])
def test_the_last_state_waits_for_its_answer_up_to_the_timeout(answered):
    loop = CountingLoop(steps=1)
    pacing = RealTimePacing(loop, 0.005)
    pacing.begin(0)
    pacing.tick(H)
    pacing.tick(2 * H)
    pacing.tick(7 * H)  # 5 ms after the step after the last would have been due
    assert not loop.finished
    if answered:
        give(pacing, H, 1.0, 7 * H)
    pacing.tick(7 * H if answered else 7 * H + 1)
    assert loop.finished


# Of somebody else's node, which names no source.


@pytest.mark.parametrize(
    ("stamp_ns", "counted"),
    [
        (1_795_000_000 * 10**9, "commands with a clock's stamp"),
        (3 * H + 1, "commands with no state's stamp"),
        (4 * H, "commands with no state's stamp"),
        (-H, "commands with no state's stamp"),
        (0, "commands without a stamp"),
    ],
)
def test_a_strangers_command_without_a_states_stamp_acts_when_it_arrives(
    real_time, stamp_ns, counted
):
    loop, pacing = real_time
    pacing.command(0, 1.0, 1001)
    for k in (1, 2, 3):
        pacing.tick(1000 + k * H)
    pacing.command(stamp_ns, 5.0, 1)
    assert pacing.command_in_use == (3 * H, 5.0, ARRIVAL)
    pacing.tick(1000 + 4 * H)
    assert loop.efforts == [1.0, 1.0, 1.0, 5.0]
    assert loop.counts == {counted: 1}
    for k in range(5, 11):
        pacing.tick(1000 + k * H)
    assert loop.efforts[4:] == [5.0] * 5 + [0.0]  # and no longer than the timeout


def test_a_strangers_first_command_stamped_0_answers_the_first_state(real_time):
    loop, pacing = real_time
    pacing.tick(1000 + H)
    pacing.command(0, 3.0, 1)
    assert pacing.command_in_use == (0, 3.0, "")
    assert loop.counts == {}


def test_a_stranger_may_answer_a_state_more_often_than_once(real_time):
    loop, pacing = real_time
    pacing.command(0, 3.0, 1)
    pacing.command(0, 4.0, 1)
    assert (
        pacing.command_in_use.effort == 3.0
    )  # the record names a command by its stamp: the first counts
    assert loop.counts == {"repeated answers ignored": 1}


@pytest.mark.parametrize("every", [2, 4])
def test_a_stranger_with_a_rate_of_its_own_leaves_no_state_unanswered(real_time, every):
    loop, pacing = real_time
    for k in range(400):
        if k % every == (k // 100) % 2:  # its timer drifts
            pacing.command(k * H, 1.0, 1)
        pacing.tick(1000 + (k + 1) * H)
    assert loop.counts == {}


def test_a_strangers_missed_turns_are_counted_by_its_usual_gap(real_time):
    loop, pacing = real_time
    for k in range(0, 400, 2):
        if k not in (300, 302):
            pacing.command(k * H, 1.0, 1)
        pacing.tick(1000 + (k + 1) * H)
        pacing.tick(1000 + (k + 2) * H)
    assert loop.counts["states unanswered"] == 2


def test_a_stranger_that_answers_every_state_is_late_as_ours_are(real_time):
    loop, pacing = real_time
    for k in range(100):
        pacing.tick(1000 + (k + 1) * H)
        pacing.command(k * H, 1.0, 1)
    assert 0 < loop.counts["commands late"] <= 100


def test_an_answer_counts_for_more_than_what_arrived_in_its_state(real_time):
    _, pacing = real_time
    pacing.tick(1000 + H)
    pacing.command(7 * H, 9.0, 1)
    pacing.command(H, 3.0, 1)
    assert pacing.command_in_use == (H, 3.0, "")
