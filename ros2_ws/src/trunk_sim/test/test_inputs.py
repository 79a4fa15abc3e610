"""What acts on the plant: answers are checked, disturbances queued, rows of plant/inputs made."""

import re
from math import inf, nan

import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_sim.disturbances import Disturbance, disturbance_sample
from trunk_sim.inputs import (
    NO_COMMAND,
    UNDISTURBED,
    Command,
    DisturbanceFeed,
    Disturbed,
    RefusedError,
    disturbance_of,
    effort_of,
    inputs_frame,
    inputs_row,
)
from trunk_sim.pacing import RealTimePacing

from .counting_loop import CountingLoop, H

JOINTS = ("hip", "trunk")


def test_a_command_is_found_by_its_joint():
    command = JointSample(0, ("other", "trunk"), effort=(1.0, 2.0))
    assert effort_of(command, "trunk") == 2.0


@pytest.mark.parametrize(
    ("names", "part", "why"),
    [
        ((), "the joint", r"their names are \[\]: 'trunk' must be there, once"),
        (("hip",), "the joint", r"their names are \['hip'\]"),
        (("trunk", "trunk"), "the joint", r"'trunk' must be there, once"),
        (("a", "trunk", "a"), "the joint", r"'trunk' must be there, once"),
        (("hip", "trunk"), "an effort", r"1 values of effort for the names \['hip', 'trunk'\]"),
        (
            tuple(f"{'x' * 90}{i}" for i in range(9)),
            "the joint",
            r"^their names are .{100,200} and 5 more",
        ),
    ],
)
def test_a_command_without_the_joint_or_its_effort_is_refused(names, part, why):
    with pytest.raises(RefusedError, match=f"^commands without {part}$") as refused:
        effort_of(JointSample(0, names, effort=(1.0,)), "trunk")
    assert re.search(why, refused.value.why)


@pytest.mark.parametrize("effort", [nan, inf, -inf])
def test_a_command_that_is_not_finite_is_refused(effort):
    with pytest.raises(RefusedError, match=r"^commands not finite$"):
        effort_of(JointSample(0, ("trunk",), effort=(effort,)), "trunk")


def test_a_disturbance_comes_back_from_its_message():
    acting = Disturbance(1.0, 2.0, 3.0, 4.0)
    assert disturbance_of(disturbance_sample(7, JOINTS, acting), JOINTS) == acting


def test_a_disturbance_of_other_joints_or_not_one_value_for_each_is_refused():
    sample = disturbance_sample(7, JOINTS, Disturbance())
    one, three = (0.0,), (0.0, 0.0, 0.0)
    for other in (
        {"name": JOINTS[::-1]},
        *({f: v} for f in ("effort", "position") for v in (one, three)),
    ):
        with pytest.raises(RefusedError, match=r"^disturbances malformed$"):
            disturbance_of(sample._replace(**other), JOINTS)


@pytest.mark.parametrize("place", range(4))
def test_a_disturbance_that_is_not_finite_is_refused(place):
    values = [0.0] * 4
    values[place] = nan
    with pytest.raises(RefusedError, match=r"^disturbances not finite$"):
        disturbance_of(disturbance_sample(7, JOINTS, Disturbance(*values)), JOINTS)


MS = 1_000_000
QUIET, PUSH, PULL = Disturbance(), Disturbance(trunk_torque=1.0), Disturbance(trunk_torque=-1.0)


def test_each_acts_from_its_stamp_on():
    feed = DisturbanceFeed(5 * MS)
    assert feed.disturbance == QUIET
    feed.take(5 * MS, PUSH, 0)
    feed.take(15 * MS, PULL, 0)
    acting = []
    for k in range(5):
        assert not feed.advance(5 * k * MS, None)
        acting.append(feed.disturbance)
    assert acting == [QUIET, PUSH, PUSH, PULL, PULL]
    assert not feed


def test_stamps_that_go_backwards_or_far_ahead_are_refused():
    feed = DisturbanceFeed(5 * MS)
    feed.take(10 * MS, PUSH, 0)
    for stamp_ns in (10 * MS, 5 * MS):
        with pytest.raises(RefusedError, match=r"^disturbances out of order$"):
            feed.take(stamp_ns, PULL, 0)
    with pytest.raises(RefusedError, match=r"^disturbances more than 1 s ahead$"):
        feed.take(1001 * MS, PULL, 0)
    feed.take(900 * MS, PULL, 0)
    # A slow plant's next step may be further away than that.
    DisturbanceFeed(3000 * MS).take(3000 * MS, PULL, 0)


def test_all_of_a_second_at_a_kilohertz_may_arrive_ahead():
    feed, acting = DisturbanceFeed(MS), []
    for k in range(1, 1001):
        feed.take(k * MS, Disturbance(hip_force=k), 0)
    for k in range(1, 1001):
        feed.advance(k * MS, None)
        acting.append(feed.disturbance.hip_force)
    assert acting == list(range(1, 1001))


def test_a_disturbance_that_is_too_old_no_longer_acts():
    feed = DisturbanceFeed(5 * MS)
    assert not feed.advance(1000 * MS, 200 * MS), "nothing was ever received"
    feed.take(1005 * MS, PUSH, 1000 * MS)
    assert not feed.advance(1205 * MS, 200 * MS)
    assert feed.disturbance == PUSH
    assert feed.advance(1210 * MS, 200 * MS)
    assert feed.disturbance == QUIET
    feed.take(1215 * MS, PULL, 1210 * MS)
    assert not feed.advance(1215 * MS, 200 * MS)
    assert feed.disturbance == PULL
    assert not feed.advance(10**6 * MS, None), "in lock-step nothing is too old"


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
        in_force, steps = pacing.command_in_use, len(loop.efforts)
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
    assert feed.in_use == UNDISTURBED
    feed.take(0, Disturbance(), 0, PUSH)
    feed.take(H, ALL, 0, PUSH)
    seen = []
    for k in range(5):
        feed.advance(k * H, 2 * H)
        assert feed.disturbance == feed.in_use.disturbance
        seen.append((feed.in_use.stamp_ns, feed.in_use.source, feed.disturbance == ALL))
    assert seen == [(0, PUSH, False), *[(H, PUSH, True)] * 3, (-1, "", False)]
    feed.take(5 * H, ALL, 4 * H)
    feed.advance(5 * H, 2 * H)
    assert feed.in_use == Disturbed(5 * H, ALL, "")
