"""A run's picture as messages: what a 3-D view gets, by readers other than ours."""

import math
from dataclasses import replace
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util.picture.film import Film, markers, scene_of, transforms, urdf
from trunk_msgs_util.picture.frames import Frame, bar_of, poses, resolved
from trunk_msgs_util.picture.shapes import FAR, Kind, Scene, is_drawn, shapes
from trunk_recording.schemas import deserialize

from ...trunk_recording.test.mcap_files import stamp_of
from .geometries import CART_POLE, TRUNK, cart_pole, trunk

GEOMETRY = trunk(joints=["pelvis", 'a "back"'])
REAL = st.floats(-50.0, 50.0)
MS = 1_000_000


def truth(stamp_ns, x=0.25, theta=0.5):
    return JointSample(stamp_ns, ("hip", "trunk"), (x, theta), (0.0, 0.0), (0.0, 7.0))


def film_of():
    film = Film()
    film.reconfigure(TRUNK, {})
    return film


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


@pytest.mark.parametrize("geometry", [GEOMETRY, cart_pole()], ids=["trunk", "cart-pole"])
@given(REAL, REAL)
def test_the_transforms_lead_to_where_the_markers_are(geometry, x, theta):
    messages = deserialize(topics.TF_TYPE, transforms(geometry, x, theta, 5))
    first, second = messages.transforms
    assert [(t.header.frame_id, t.child_frame_id) for t in messages.transforms] == [
        ("world", f"{geometry.picture.frames[0].name}_link"),
        (f"{geometry.picture.frames[0].name}_link", f"{geometry.picture.frames[1].name}_link"),
    ]
    assert stamp_of(first.header.stamp) == stamp_of(second.header.stamp) == 5
    at = first.transform.translation
    arm = rotated(second.transform.rotation, (0.0, 0.0, geometry.reach))
    tip = (at.x + arm[0], at.y + arm[1], at.z + arm[2])
    assert tip == pytest.approx(geometry.points(geometry.held, x, theta)[-1], abs=1e-9)


@given(REAL, REAL)
def test_a_pole_leans_back_for_a_positive_angle(x, theta):
    geometry = cart_pole()
    pole = geometry.points(geometry.held, x, theta)
    assert pole[0] == (x, 0.0, 0.0)
    end = (x - 0.5 * math.sin(theta), 0.0, 0.5 * math.cos(theta))
    assert pole[1] == pytest.approx(end, abs=1e-9)
    drawn = {shape.name: shape for shape in shapes(geometry, Scene(x, theta, 20.0, theta))}
    assert drawn["mass"].points == drawn["pole"].points[1:] == pole[1:]
    assert drawn["reference"].points == pole
    assert drawn["cart"].points == ((x - 0.15, 0.0, 0.0), (x + 0.15, 0.0, 0.0))
    start, head = drawn["torque"].points  # of a force: at the cart, forwards
    assert start == (x, 0.0, 0.0)
    assert head == pytest.approx((x + 0.8 * math.tanh(0.5), 0.0, 0.0))
    assert list(drawn)[-2:] == ["disturbance/cart", "disturbance/pole"]


def test_frames_stand_in_frames_and_numbers_may_be_parameters():
    arm = Frame("arm", at=(1.0, "plant.length"), turns=0)
    picture = resolved(
        CART_POLE._replace(
            frames=(arm, Frame("pole", "arm", (0.0, -0.5), turns=1)),
            visuals=(CART_POLE.visuals[1]._replace(name="shadow"), *CART_POLE.visuals[1:]),
            track=None,
        ),
        {"plant.length": 2.0},
    )
    placed = poses(picture, (0.5 * math.pi, math.pi))
    assert placed["arm"] == (1.0, 2.0, 0.5 * math.pi, 1.0)
    assert placed["pole"] == pytest.approx((0.5, 2.0, 1.5 * math.pi, 1.0), abs=1e-15)
    assert bar_of(picture, 0) is None
    assert bar_of(picture, 1) == picture.visuals[1], "the last bar"
    with pytest.raises(KeyError, match=r"plant\.length"):
        resolved(CART_POLE, {})
    drawn = [shape.name for shape in shapes(cart_pole(picture), Scene(0.0, 0.0))]
    assert drawn[0] == "reference", "a pivot has no track"


@pytest.mark.parametrize(("sense", "force"), [(1.0, 7.0), (-1.0, 7.0), (-1.0, -7.0)])
@given(theta=REAL)
def test_the_arrow_is_where_the_driven_bar_goes(sense, force, theta):
    hanging = CART_POLE._replace(
        frames=(Frame("cart", slides=0), Frame("pole", "cart", turns=1, sense=sense)),
        visuals=(CART_POLE.visuals[1]._replace(points=((0.0, 0.0), (0.3, -0.4))),),
    )
    geometry = replace(cart_pole(hanging), drive=1)
    start, head = next(
        s for s in shapes(geometry, Scene(0.0, theta, force)) if s.name == "torque"
    ).points
    assert start == geometry.points(geometry.held, 0.0, theta)[-1]
    moved = geometry.points(geometry.held, 0.0, theta + math.copysign(1e-6, force))[-1]
    ways = [[b - a for a, b in zip(start, end, strict=True)] for end in (head, moved)]
    parts = [[part / math.hypot(*way) for part in way] for way in ways]
    assert parts[0] == pytest.approx(parts[1], abs=1e-4)


@pytest.mark.parametrize("at", [(2.0 * FAR, 0.0), (0.0, math.inf), (math.nan, 0.0)])
def test_what_is_too_far_is_not_drawn(at):
    assert not is_drawn(cart_pole(), Scene(*at))
    assert is_drawn(cart_pole(), Scene(FAR, 1e6))


def joints_of(root):
    return {
        joint.get("name"): (
            joint.get("type"),
            joint.find("parent").get("link"),
            joint.find("child").get("link"),
            joint.find("axis").get("xyz"),
        )
        for joint in root.iter("joint")
    }


def test_the_urdf_of_another_plant_has_its_frames_and_bars():
    wheel = Frame("wheel", "cart", (0.1, -0.05), turns=0, sense=20.0)
    frames = (*CART_POLE.frames[:1], wheel, *CART_POLE.frames[1:])
    root = ElementTree.fromstring(urdf(cart_pole(CART_POLE._replace(frames=frames))))
    assert root.get("name") == "pole"
    assert joints_of(root) == {
        "cart": ("prismatic", "world", "cart_link", "1 0 0"),
        "wheel": ("continuous", "cart_link", "wheel_link", "0 1 0"),
        "pole": ("continuous", "cart_link", "pole_link", "0 -1 0"),
    }
    (origin,) = (
        joint.find("origin") for joint in root.iter("joint") if joint.get("name") == "wheel"
    )
    assert origin.get("xyz") == "0.1 0 -0.05"
    (cart,) = root.find("link[@name='cart_link']")
    assert cart.find(".//cylinder").attrib == {"radius": "0.06", "length": "0.3"}
    assert cart.find("origin").get("rpy") == f"0 {math.pi / 2.0!r} 0"  # along x


def test_the_urdf_joins_the_links_of_the_transforms_by_the_joints_of_the_states():
    root = ElementTree.fromstring(urdf(GEOMETRY))
    assert joints_of(root) == {
        "pelvis": ("prismatic", "world", "hip_link", "1 0 0"),
        'a "back"': ("continuous", "hip_link", "trunk_link", "0 1 0"),
    }
    assert {link.get("name") for link in root.iter("link")} == {"world", "hip_link", "trunk_link"}
    assert root.find(".//cylinder").get("length") == "1.3"
    materials = {material.get("name") for material in root.findall("material")}
    assert {used.get("name") for used in root.iter("material")} == materials


def test_markers_have_what_each_kind_of_shape_needs():
    drawn = shapes(GEOMETRY, Scene(0.1, 0.2, 30.0, None, True, False))
    messages = deserialize(topics.MARKER_ARRAY_TYPE, markers(drawn, 1_500_000_000))
    assert [marker.ns for marker in messages.markers] == [shape.name for shape in drawn]
    for marker, shape in zip(messages.markers, drawn, strict=True):
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
        film = film_of()
        stamps = [k * MS for k in range(0, 1001, period)]
        drawn = [
            t for t in stamps if film.is_due(t) and list(film.picture(truth(t), None, None, t))
        ]
        assert drawn[0] == 0
        assert len(drawn) == pytest.approx(min(31, len(stamps)), abs=1)
        assert film.is_due(0)


def test_nothing_is_drawn_before_the_plant_is_known():
    film = Film()
    film.reconfigure({}, {"plant.length": 2.0})
    assert list(film.picture(truth(0), None, None, 0)) == []
    film.reconfigure(TRUNK, {})
    assert len(list(film.picture(truth(0), None, None, 0))) == 3


def test_a_frame_that_does_not_move_is_a_fixed_joint_of_its_name():
    cart, pole = CART_POLE.frames
    frames = (Frame("rail", at=(0.0, 0.1)), cart._replace(on="rail"), pole)
    robot = ElementTree.fromstring(urdf(cart_pole(CART_POLE._replace(frames=frames))))
    joints = [(joint.get("name"), joint.get("type")) for joint in robot.findall("joint")]
    assert joints == [("rail", "fixed"), ("cart", "prismatic"), ("pole", "continuous")]


def test_a_bar_that_ends_where_it_turns_is_drawn_without_an_arrow():
    body, bar, mass = CART_POLE.visuals
    visuals = (body, bar._replace(points=bar.points[::-1]), mass)
    geometry = replace(cart_pole(CART_POLE._replace(visuals=visuals)), drive=1)
    drawn = {shape.name: shape.points for shape in shapes(geometry, Scene(0.0, 0.1, 5.0))}
    assert drawn["torque"] == ()
    assert len(drawn["pole"]) == 2


def test_a_plant_that_is_not_installed_is_not_drawn_and_said_once():
    film = film_of()
    problem = film.reconfigure({**TRUNK, "plant.name": "furuta"}, {})
    assert problem.startswith("no picture is drawn: parameter 'plant.name': 'furuta'")
    assert "install the package that has it" in problem
    assert film.reconfigure({}, {"plant.length": 2.0}) == ""
    assert list(film.picture(truth(0), None, None, 0)) == []


def test_a_simulator_that_starts_again_has_another_plant():
    film = Film()
    film.reconfigure({"plant.name": "cart_pole", "plant.length": 0.5, "joints": ("a", "b")}, {})
    assert film.geometry == replace(cart_pole(), joints=("a", "b"))
    film.reconfigure(TRUNK, {})
    assert film.geometry == trunk()


def test_the_description_comes_first_and_again_when_it_changes():
    film = film_of()
    messages = [[topic for topic, _ in film.picture(truth(t), None, None, t)] for t in (0, 50 * MS)]
    assert messages == [["robot_description", "markers", "tf"], ["markers", "tf"]]
    film.reconfigure({}, {"plant.length": 2.0, "plant.gravity": 1.6})
    again = dict(film.picture(truth(100 * MS), None, None, 100 * MS))
    assert list(again) == ["robot_description", "markers", "tf"]
    text = deserialize(topics.STRING_TYPE, again["robot_description"]).data
    assert text == urdf(trunk(plant_length=2.0))


def test_states_without_our_joints_or_without_finite_numbers_are_not_drawn():
    film = film_of()
    for state in (JointSample(0, ("wheel",), (1.0,)), JointSample(0, ("hip", "trunk"), (1.0,))):
        assert not {"markers", "tf"} & dict(film.picture(state, None, None, 0)).keys()
    for state in (truth(0, x=math.inf), truth(0, x=math.nan), truth(0, theta=math.nan)):
        messages = dict(film.picture(state, None, None, 0))
        assert list(messages) == ["markers"]
        array = deserialize(topics.MARKER_ARRAY_TYPE, messages["markers"])
        assert {marker.action for marker in array.markers} == {2}
    pushed = JointSample(0, ("hip", "trunk"), (0.0, 0.1), (), (0.0, 0.0))
    scene = scene_of(trunk(), truth(0), pushed, 0.3)
    assert scene == Scene(0.25, 0.5, 7.0, 0.3, False, True)
