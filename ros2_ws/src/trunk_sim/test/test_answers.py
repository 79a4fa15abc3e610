"""Which commands and disturbances the simulator takes, and under which name it counts the others."""

from __future__ import annotations

import re
from math import inf, nan

import pytest

from trunk_msgs_util.samples import JointSample
from trunk_sim.answers import RefusedError, disturbance_of, effort_of
from trunk_sim.disturbances import Disturbance, disturbance_sample

JOINTS = ("hip", "trunk")


def test_a_command_is_found_by_its_joint():
    command = JointSample(0, ("other", "trunk"), effort=(1.0, 2.0))
    assert effort_of(command, "trunk") == 2.0


@pytest.mark.parametrize(
    ("names", "what", "why"),
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
def test_a_command_without_the_joint_or_its_effort_is_refused(names, what, why):
    with pytest.raises(RefusedError, match=f"^commands without {what}$") as refused:
        effort_of(JointSample(0, names, effort=(1.0,)), "trunk")
    assert re.search(why, refused.value.why)


@pytest.mark.parametrize("effort", [nan, inf, -inf])
def test_a_command_that_is_not_finite_is_refused(effort):
    with pytest.raises(RefusedError, match=r"^commands not finite$"):
        effort_of(JointSample(0, ("trunk",), effort=(effort,)), "trunk")


def test_a_disturbance_comes_back_from_its_message():
    acting = Disturbance(1.0, 2.0, 3.0, 4.0)
    assert disturbance_of(disturbance_sample(7, JOINTS, acting), JOINTS) == acting


def test_a_disturbance_of_other_joints_is_refused():
    sample = disturbance_sample(7, ("trunk", "hip"), Disturbance())
    with pytest.raises(RefusedError, match=r"^disturbances malformed$"):
        disturbance_of(sample, JOINTS)


@pytest.mark.parametrize("place", range(4))
def test_a_disturbance_that_is_not_finite_is_refused(place):
    values = [0.0] * 4
    values[place] = nan
    with pytest.raises(RefusedError, match=r"^disturbances not finite$"):
        disturbance_of(disturbance_sample(7, JOINTS, Disturbance(*values)), JOINTS)
