"""A run's picture as messages: what a 3-D view gets, by readers other than ours."""

import math
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_msgs_util import topics
from trunk_msgs_util.picture.film import Film, markers, scene_of, transforms, urdf
from trunk_msgs_util.picture.shapes import Geometry, Kind, Scene, shapes
from trunk_msgs_util.recording.schemas import deserialize
from trunk_msgs_util.samples import JointSample

from .mcap_files import stamp_of

GEOMETRY = Geometry(length=1.3, amplitude=0.7, wavenumber=2.0, joints=("pelvis", 'a "back"'))
REAL = st.floats(-50.0, 50.0)
MS = 1_000_000


def truth(stamp_ns, x=0.25, theta=0.5):
    return JointSample(stamp_ns, ("hip", "trunk"), (x, theta), (0.0, 0.0), (0.0, 7.0))


def rotated(q, v):
    """Return a vector turned by a unit quaternion: v + 2 u x (u x v + w v)."""

    def cross(a, b):
        return (
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        )

    u = (q.x, q.y, q.z)
    inner = tuple(c + q.w * x for c, x in zip(cross(u, v), v, strict=True))
    return tuple(x + 2.0 * c for x, c in zip(v, cross(u, inner), strict=True))


@given(REAL, REAL)
def test_the_transforms_lead_to_where_the_markers_are(x, theta):
    told = deserialize(topics.TF_TYPE, transforms(GEOMETRY, x, theta, 5))
    hip, trunk = told.transforms
    assert [(t.header.frame_id, t.child_frame_id) for t in told.transforms] == [
        ("world", "hip_link"),
        ("hip_link", "trunk_link"),
    ]
    assert stamp_of(hip.header.stamp) == stamp_of(trunk.header.stamp) == 5
    at = hip.transform.translation
    arm = rotated(trunk.transform.rotation, (0.0, 0.0, GEOMETRY.length))
    mass = (at.x + arm[0], at.y + arm[1], at.z + arm[2])
    assert mass == pytest.approx(GEOMETRY.mass(x, theta), abs=1e-9)


def test_the_urdf_joins_the_links_of_the_transforms_by_the_joints_of_the_states():
    root = ElementTree.fromstring(urdf(GEOMETRY))
    joints = {
        joint.get("name"): (
            joint.get("type"),
            joint.find("parent").get("link"),
            joint.find("child").get("link"),
            joint.find("axis").get("xyz"),
        )
        for joint in root.iter("joint")
    }
    assert joints == {
        "pelvis": ("prismatic", "world", "hip_link", "1 0 0"),
        'a "back"': ("continuous", "hip_link", "trunk_link", "0 1 0"),
    }
    assert {link.get("name") for link in root.iter("link")} == {"world", "hip_link", "trunk_link"}
    assert root.find(".//cylinder").get("length") == "1.3"
    materials = {material.get("name") for material in root.findall("material")}
    assert {used.get("name") for used in root.iter("material")} == materials


def test_markers_have_what_each_kind_of_shape_needs():
    drawn = shapes(GEOMETRY, Scene(0.1, 0.2, 30.0, None, True, False))
    told = deserialize(topics.MARKER_ARRAY_TYPE, markers(drawn, 1_500_000_000))
    assert [marker.ns for marker in told.markers] == [shape.name for shape in drawn]
    for marker, shape in zip(told.markers, drawn, strict=True):
        assert marker.type == shape.kind
        assert marker.action == (0 if shape.points else 2)
        assert (marker.header.frame_id, stamp_of(marker.header.stamp)) == ("world", 1_500_000_000)
        if not shape.points:
            continue
        assert marker.pose.orientation.w == 1.0
        assert marker.color.a > 0.0
        points = [(p.x, p.y, p.z) for p in marker.points]
        if shape.kind is Kind.SPHERE:
            at = marker.pose.position
            assert ((at.x, at.y, at.z), points) == (shape.points[0], [])
            assert marker.scale.x == marker.scale.y == marker.scale.z == shape.size
        else:
            assert points == list(shape.points)
            assert marker.scale.x == shape.size


def test_thirty_pictures_a_second_at_any_rate_and_again_when_time_restarts():
    for period in (1, 5, 7, 50):
        film = Film()
        stamps = [k * MS for k in range(0, 1001, period)]
        drawn = [
            t for t in stamps if film.is_due(t) and list(film.picture(truth(t), None, None, t))
        ]
        assert drawn[0] == 0
        assert len(drawn) == pytest.approx(min(31, len(stamps)), abs=1)
        assert film.is_due(0)


def test_the_description_comes_first_and_again_when_it_changes():
    film = Film()
    told = [[topic for topic, _ in film.picture(truth(t), None, None, t)] for t in (0, 50 * MS)]
    assert told == [["robot_description", "markers", "tf"], ["markers", "tf"]]
    film.reconfigure({"plant.length": 2.0, "plant.gravity": 1.6})
    again = dict(film.picture(truth(100 * MS), None, None, 100 * MS))
    assert list(again) == ["robot_description", "markers", "tf"]
    text = deserialize(topics.STRING_TYPE, again["robot_description"]).data
    assert text == urdf(Geometry(length=2.0))


def test_states_without_our_joints_or_without_finite_numbers_are_not_drawn():
    film = Film()
    for state in (JointSample(0, ("wheel",), (1.0,)), JointSample(0, ("hip", "trunk"), (1.0,))):
        assert not {"markers", "tf"} & dict(film.picture(state, None, None, 0)).keys()
    for state in (truth(0, x=math.inf), truth(0, x=math.nan), truth(0, theta=math.nan)):
        told = dict(film.picture(state, None, None, 0))
        assert list(told) == ["markers"]
        array = deserialize(topics.MARKER_ARRAY_TYPE, told["markers"])
        assert {marker.action for marker in array.markers} == {2}
    pushed = JointSample(0, ("hip", "trunk"), (0.0, 0.1), (), (0.0, 0.0))
    scene = scene_of(Geometry(), truth(0), pushed, 0.3)
    assert scene == Scene(0.25, 0.5, 7.0, 0.3, False, True)
