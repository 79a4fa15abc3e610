"""Which of the received disturbances acts at a stamp."""

from __future__ import annotations

import pytest

from trunk_sim.answers import RefusedError
from trunk_sim.disturbance_feed import DisturbanceFeed
from trunk_sim.disturbances import Disturbance

MS = 1_000_000
QUIET, PUSH, PULL = Disturbance(), Disturbance(trunk_torque=1.0), Disturbance(trunk_torque=-1.0)


def test_each_acts_from_its_stamp_on():
    feed = DisturbanceFeed(5 * MS)
    assert feed.acting == QUIET
    feed.take(5 * MS, PUSH, 0)
    feed.take(15 * MS, PULL, 0)
    acting = []
    for k in range(5):
        assert not feed.advance(5 * k * MS, None)
        acting.append(feed.acting)
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


def test_a_disturbance_that_is_too_old_no_longer_acts():
    feed = DisturbanceFeed(5 * MS)
    assert not feed.advance(1000 * MS, 200 * MS), "nothing was ever received"
    feed.take(1005 * MS, PUSH, 1000 * MS)
    assert not feed.advance(1205 * MS, 200 * MS)
    assert feed.acting == PUSH
    assert feed.advance(1210 * MS, 200 * MS)
    assert feed.acting == QUIET
    feed.take(1215 * MS, PULL, 1210 * MS)
    assert not feed.advance(1215 * MS, 200 * MS)
    assert feed.acting == PULL
    assert not feed.advance(10**6 * MS, None), "in lock-step nothing is too old"
