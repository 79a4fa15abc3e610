"""What acts on the plant, as a row of ``plant/inputs`` says it."""

from __future__ import annotations

from trunk_msgs_util import topics
from trunk_sim.acting import (
    NO_COMMAND,
    UNDISTURBED,
    Command,
    Disturbed,
    inputs_frame,
    inputs_row,
)
from trunk_sim.disturbance_feed import DisturbanceFeed
from trunk_sim.disturbances import Disturbance
from trunk_sim.pacing import RealTimePacing

from .counting_loop import CountingLoop, H

PLANT, PID, PUSH = "simulator@b.1.2", "pid@b.3.4", "disturbance@b.5.6"
ALL = Disturbance(1.0, 2.0, 3.0, 4.0)


def test_a_row_has_each_value_and_its_age():
    row = inputs_row(10 * H, Command(7 * H, -5.0, PID), Disturbed(10 * H, ALL, PUSH))
    assert row.stamp_ns == 10 * H
    assert row.name == topics.INPUT_NAMES
    assert dict(zip(row.name, row.position, strict=True)) == {"command": -5.0, **ALL._asdict()}
    assert row.velocity == (3.0 * H, 0.0, 0.0, 0.0, 0.0)
    assert row.effort == ()


def test_where_nothing_acts_the_age_is_negative():
    row = inputs_row(0, NO_COMMAND, UNDISTURBED)
    assert row.position == (0.0,) * 5
    assert row.velocity == (-1.0,) * 5
    assert inputs_frame(PLANT, NO_COMMAND, UNDISTURBED) == f"{PLANT} - -"


def test_an_age_is_exact_for_a_hundred_days():
    stamp_ns = 100 * 86_400 * 10**9 + 1
    assert int(inputs_row(stamp_ns, Command(0, 1.0, PID), UNDISTURBED).velocity[0]) == stamp_ns


def test_the_frame_names_the_senders():
    command, disturbed = Command(0, 1.0, PID), Disturbed(0, ALL, PUSH)
    assert inputs_frame(PLANT, command, disturbed) == f"{PLANT} {PID} {PUSH}"
    stranger = command._replace(source="")
    assert inputs_frame(PLANT, stranger, disturbed) == f"{PLANT} - {PUSH}"


def test_the_command_in_force_is_the_one_that_the_plant_steps_with():
    loop = CountingLoop()
    pacing = RealTimePacing(loop, command_timeout=2 * H / 1e9)
    pacing.begin(0)
    seen = []

    def step(now_ns):
        in_force, steps = pacing.in_force, len(loop.efforts)
        pacing.tick(now_ns)
        assert loop.efforts[steps:] == [in_force.effort] * (len(loop.efforts) - steps)
        seen.append((in_force.stamp_ns, in_force.source))

    step(H)
    pacing.command(H, 3.0, H, PID)
    for k in range(2, 6):
        step(k * H)
    pacing.command(3 * H, 4.0, 5 * H)  # a stranger's, late
    pacing.command(3 * H, 9.0, 5 * H, PID)  # one more for the same state is ignored
    step(6 * H)
    assert seen == [(-1, ""), (H, PID), (H, PID), (H, PID), (-1, ""), (3 * H, "")]
    assert loop.counts["steps without a fresh command"] == 1


def test_the_disturbance_in_force_is_the_one_that_acts():
    feed = DisturbanceFeed(H)
    assert feed.in_force == UNDISTURBED
    feed.take(0, Disturbance(), 0, PUSH)
    feed.take(H, ALL, 0, PUSH)
    seen = []
    for k in range(5):
        feed.advance(k * H, 2 * H)
        assert feed.acting == feed.in_force.disturbance
        seen.append((feed.in_force.stamp_ns, feed.in_force.source, feed.acting == ALL))
    assert seen == [(0, PUSH, False), *[(H, PUSH, True)] * 3, (-1, "", False)]
    feed.take(5 * H, ALL, 4 * H)
    feed.advance(5 * H, 2 * H)
    assert feed.in_force == Disturbed(5 * H, ALL, "")
