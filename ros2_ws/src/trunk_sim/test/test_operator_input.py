"""Requests of an operator: whose are accepted, how large they may be, and for how long they act."""

from math import inf, nan

import pytest

from trunk_core.samples import JointSample
from trunk_sim.disturbances import Disturbance
from trunk_sim.inputs import (
    NOTHING,
    Applied,
    Operator,
    OperatorLimits,
    RefusedError,
    request_of,
    with_operator,
)

LIMITS = OperatorLimits(hip_force=10.0, trunk_torque=50.0, timeout_ns=100)
PUSH = Applied(0.0, 20.0)


def test_a_push_is_limited_and_ends_when_no_request_comes():
    operator = Operator(LIMITS)
    assert operator.applied(0) == NOTHING
    assert operator.new_request() is None
    operator.take("a", 0, Applied(-99.0, 99.0), 5)
    assert operator.new_request() == Applied(-10.0, 50.0)
    assert operator.new_request() is None
    assert operator.applied(5) == operator.applied(105) == Applied(-10.0, 50.0)
    assert operator.applied(106) == NOTHING


def test_one_operator_at_a_time():
    operator = Operator(LIMITS)
    operator.take("a", 0, PUSH, 0)
    with pytest.raises(RefusedError, match="second operator"):
        operator.take("b", 50, NOTHING, 50)
    assert operator.applied(60) == PUSH
    operator.take("b", 101, Applied(1.0, 0.0), 101)
    assert operator.applied(101) == Applied(1.0, 0.0)


@pytest.mark.parametrize(
    ("name", "stamp_ns", "match"),
    [
        ("", 200, "without a name"),
        ("x" * 65, 200, "without a name"),
        ("a", 201, "out of time"),
        ("a", 99, "out of time"),
        ("a", 149, "out of order"),
    ],
)
def test_what_is_refused(name, stamp_ns, match):
    operator = Operator(LIMITS)
    operator.take("a", 150, PUSH, 190)
    with pytest.raises(RefusedError, match=match):
        operator.take(name, stamp_ns, NOTHING, 200)
    assert operator.applied(200) == PUSH


@pytest.mark.parametrize(
    ("names", "effort"),
    [(("hip",), (1.0,)), (("trunk", "hip"), (0.0, 1.0)), (("hip", "trunk"), (1.0,))],
)
def test_a_malformed_request(names, effort):
    with pytest.raises(RefusedError, match="malformed"):
        request_of(JointSample(0, names, effort=effort), ("hip", "trunk"))


@pytest.mark.parametrize("more", [{"position": (0.0, 0.0)}, {"velocity": (1.0,)}])
def test_a_request_holds_efforts_only(more):
    with pytest.raises(RefusedError, match="malformed"):
        request_of(JointSample(0, ("hip", "trunk"), effort=(0.0, 1.0), **more), ("hip", "trunk"))


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_a_request_that_is_not_finite(value):
    with pytest.raises(RefusedError, match="not finite"):
        request_of(JointSample(0, ("hip", "trunk"), effort=(0.0, value)), ("hip", "trunk"))


def test_a_push_is_added_to_the_disturbance_and_no_push_changes_nothing():
    acting = Disturbance(-0.0, 1.0, 2.0, 3.0)
    assert with_operator(acting, NOTHING) is acting
    assert with_operator(acting, Applied(1.0, 2.0)) == Disturbance(1.0, 3.0, 2.0, 3.0)
