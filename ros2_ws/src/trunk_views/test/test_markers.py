import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from trunk_core.elementary import LARGEST_ANGLE
from trunk_core.mechanics import path_height
from trunk_core.parameters.declarations import ParameterError, build, values_of
from trunk_msgs_util.picture.frames import Track
from trunk_msgs_util.picture.shapes import FAR, Geometry, Kind, Scene, path, shapes
from trunk_sim.config import TrunkSimulator
from trunk_views.markers import MarkersConfig

GEOMETRY = Geometry.from_parameters(
    {**values_of(TrunkSimulator(length=1.3, amplitude=0.7, wavenumber=2.0))}
)
REAL = st.floats(-50.0, 50.0)
ANY = st.floats()


def picture(scene, geometry=GEOMETRY):
    return {shape.name: shape for shape in shapes(geometry, scene)}


@given(REAL, REAL)
def test_the_trunk_has_its_length_and_leans_forward(x, theta):
    hip, mass = picture(Scene(x, theta))["trunk"].points
    assert hip == (x, 0.0, pytest.approx(0.7 * math.sin(2.0 * x)))
    assert math.dist(hip, mass) == pytest.approx(1.3)
    assert math.atan2(mass[0] - hip[0], mass[2] - hip[2]) == pytest.approx(
        math.remainder(theta, math.tau), abs=1e-9
    )


@given(REAL, REAL, st.floats(-500.0, 500.0))
def test_the_arrow_turns_with_the_torque(x, theta, torque):
    arrow = picture(Scene(x, theta, torque))["torque"]
    assert bool(arrow.points) == (0.8 * math.tanh(abs(torque) / 40.0) >= 0.005)
    if arrow.points:
        hip, mass = picture(Scene(x, theta))["trunk"].points
        start, end = arrow.points
        assert start == mass
        lever = (mass[0] - hip[0], mass[2] - hip[2])
        push = (end[0] - start[0], end[2] - start[2])
        assert lever[0] * push[0] + lever[1] * push[1] == pytest.approx(0.0, abs=1e-9)
        # positive torque leans it forward: from z towards x
        assert math.copysign(1.0, lever[1] * push[0] - lever[0] * push[1]) == math.copysign(
            1.0, torque
        )
        assert math.hypot(*push) <= 0.8


@given(ANY, ANY, ANY, st.none() | ANY)
@example(9e307, 0.0, 0.0, None)
@example(823546.0, 0.0, 0.0, None)  # so far along the path that its sine is not known
def test_all_shapes_are_present_and_finite_for_any_input(x, theta, torque, reference):
    found = shapes(GEOMETRY, Scene(x, theta, torque, reference, True, True))
    assert [s.name for s in found] == [s.name for s in shapes(GEOMETRY, Scene(0.0, 0.0))]
    assert all(math.isfinite(v) for s in found for point in s.points for v in point)
    known = abs(x) <= FAR and max(2.0 * (abs(x) + 4.05), abs(theta)) <= LARGEST_ANGLE
    assert any(s.points for s in found) == known


def test_each_kind_has_the_points_that_it_needs():
    least = {Kind.ARROW: 2, Kind.SPHERE: 1, Kind.LINE: 2}
    for shape in shapes(GEOMETRY, Scene(0.1, 0.2, 30.0, 0.3, True, True)):
        assert len(shape.points) >= least[shape.kind], shape.name


def test_the_path_is_near_the_hip_and_stays_on_its_grid():
    near, nearer = (path(GEOMETRY.picture.track, x) for x in (1.0, 1.049))
    assert near[0][0] == pytest.approx(-3.0, abs=0.06)
    assert near[-1][0] == pytest.approx(5.0, abs=0.06)
    assert len(set(near) & set(nearer)) >= len(near) - 1


def test_reference_and_disturbance_are_shown_if_present():
    quiet = picture(Scene(0.0, 0.2))
    assert [n for n, s in quiet.items() if not s.points] == [
        "reference",
        "torque",
        "disturbance/hip",
        "disturbance/trunk",
    ]
    busy = picture(Scene(0.0, 0.2, reference=0.2, trunk_disturbed=True))
    assert busy["reference"].points == busy["trunk"].points
    assert busy["disturbance/trunk"].points == busy["mass"].points


def test_constants_come_from_the_simulators_parameters():
    usual = values_of(TrunkSimulator())
    drawn = Geometry.from_parameters({**usual, "plant.length": 2.0, "joints": ["a", "b"]})
    assert (drawn.reach, drawn.joints, drawn.picture.track) == (2.0, ("a", "b"), Track(1.0, 1.0))
    given = {"path.cosines": [0.1], "path.sines": [0.2, 0.3], "path.amplitude": 0.0}
    drawn = Geometry.from_parameters({**usual, **given})
    assert drawn.origin(0.7)[2] == path_height(0.7, 0.0, 1.0, (0.1, 0.2, 0.0, 0.3)) != 0.0
    with pytest.raises(KeyError):
        Geometry.from_parameters(given)


def test_no_more_than_thirty_pictures_a_second():
    assert build(MarkersConfig, {"rate": 30}).rate == 30.0
    with pytest.raises(ParameterError):
        build(MarkersConfig, {"rate": 31.0})
