import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.controller import JointPlaces, Places

NAMES = st.lists(st.text(max_size=6), unique=True, max_size=8).map(tuple)


@given(st.lists(NAMES, max_size=6), st.text(max_size=6))
def test_the_index_follows_the_name_whatever_came_before(messages, joint):
    places = JointPlaces(joint)
    for names in messages:
        indices = places(names)
        assert indices == (Places(names.index(joint), None) if joint in names else None)


@given(st.lists(NAMES, max_size=6), st.text(max_size=6), st.text(max_size=6))
def test_a_law_that_needs_two_joints_finds_both_or_none(messages, joint, hip):
    places = JointPlaces(joint, hip)
    for names in messages:
        indices = places(names)
        if joint in names and hip in names:
            assert indices == Places(names.index(joint), names.index(hip))
            assert indices.last < len(names)
        else:
            assert indices is None


def test_publishers_may_alternate_on_a_topic():
    places = JointPlaces("torso", "base")
    whole, arm, half = ("base", "torso"), ("elbow", "wrist"), ("elbow", "torso")
    for names, expected in [(whole, (1, 0)), (arm, None), (half, None), (whole, (1, 0))]:
        assert places(names) == expected


@pytest.mark.parametrize("name", ["trunk", "left/knee joint", "θ", "0"])
def test_any_string_may_name_a_joint(name):
    assert JointPlaces(name)(("x", name)) == Places(1, None)


@pytest.mark.parametrize("names", [("trunk", "trunk"), ("a", "trunk", "a"), ("", "trunk", "")])
def test_a_message_with_a_doubled_name_is_not_used(names):
    """Readers of a recording leave it out, too."""
    places = JointPlaces("trunk")
    assert places(("trunk",)) == Places(0, None)
    assert places(names) is None
    assert places(("a", "trunk")) == Places(1, None)
