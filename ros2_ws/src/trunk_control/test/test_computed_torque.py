"""Computed torque: the model's limiting cases, the error equation it imposes, the inputs it needs."""

from math import inf, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.computed_torque import ComputedTorqueConfig, computed_torque_update
from trunk_control.controller import Controller, hip_index, hip_seen
from trunk_control.law import DERIVATIVE_FROM_RATE, Hip, Limits, Sample
from trunk_control.pid import PidConfig
from trunk_control.pid_family import Gains, PidState
from trunk_core.mechanics import Body, inverse_dynamics

ANGLE = st.floats(-pi, pi)
SPEED = st.floats(-5.0, 5.0)
LIMITS = Limits(derivative=DERIVATIVE_FROM_RATE)


@given(ANGLE, SPEED, ANGLE, SPEED)
def test_a_heavy_hip_tends_to_the_prescribed_model(x, x_dot, theta, theta_dot):
    # A hip of infinite mass falls along its path by itself; without gravity it coasts.
    heavy = Body(hip_mass=1e12, gravity=0.0, amplitude=0.0)
    hip = Hip(x, x_dot)
    free, given_ = (
        inverse_dynamics(hip.position, theta, hip.velocity, theta_dot, heavy, prescribed)
        for prescribed in (False, True)
    )
    assert free == pytest.approx(given_, abs=1e-9)


@given(ANGLE)
def test_a_level_path_gives_the_cart_and_pole(theta):
    model = Body(amplitude=0.0)
    inertia, bias = inverse_dynamics(3.0, theta, 1.0, 0.0, model)
    total = model.hip_mass + model.trunk_mass
    expected = model.trunk_mass * (model.hip_mass + model.trunk_mass * sin(theta) ** 2) / total
    assert inertia == pytest.approx(expected)
    assert bias == pytest.approx(-model.trunk_mass * model.gravity * sin(theta), abs=1e-12)


@given(ANGLE, SPEED, ANGLE, SPEED)
def test_terms_are_the_gains_times_the_inertia(x, x_dot, theta, theta_dot):
    hip, gains = Hip(x, x_dot), Gains(100.0, 10.0, 20.0)
    inertia, bias = inverse_dynamics(hip.position, theta, hip.velocity, theta_dot, Body())
    assert inertia > 0.0
    sample = Sample(0.3, theta, theta_dot, 0.01, hip)
    state, terms = computed_torque_update(PidState(), sample, (gains, Body(), False), LIMITS)
    wanted = 100.0 * (0.3 - theta) + 10.0 * state.integral - 20.0 * theta_dot
    assert terms.effort == pytest.approx(inertia * wanted + bias, abs=1e-9)
    assert (terms.kp, terms.ki, terms.kd) == tuple(inertia * gain for gain in gains)


@pytest.mark.parametrize("bad", range(4), ids=["x", "x_dot", "angle", "rate"])
@pytest.mark.parametrize("value", [nan, 1e200], ids=["nan", "overflow"])
def test_a_bad_sample_holds_the_command(bad, value):
    motion = [0.1, 0.2, 0.3, 0.4]
    motion[bad] = value
    x, x_dot, theta, theta_dot = motion
    if value > 0.0 and bad in (0, 2):
        return  # large angles and positions are valid
    state = PidState(effort=2.5, started=True)
    constants = Gains(1.0, 0.0, 1.0), Body(), False
    sample = Sample(0.0, theta, theta_dot, 0.01, Hip(x, x_dot))
    held, terms = computed_torque_update(state, sample, constants, LIMITS)
    assert held is state
    assert terms.effort == 2.5


def test_an_infinite_angle_is_held():
    controller = Controller(ComputedTorqueConfig())
    before = controller.update(0, 0.1, 0.0, hip=Hip(0.0, 1.0))
    for bad in ((inf, 0.0), (nan, 0.0), (0.1, inf)):
        assert controller.update(10_000_000, *bad).effort == before.effort


def test_the_hip_is_found_by_name():
    config = ComputedTorqueConfig(hip_joint="pelvis")
    assert hip_index(config, ("trunk", "pelvis")) == 1
    assert hip_seen(1, (0.1, 0.2), (0.3, 0.4)) == Hip(0.2, 0.4)
    assert hip_index(PidConfig(), ("trunk",)) is None
    assert hip_seen(None, (), ()) == Hip()
    with pytest.raises(ValueError, match="not in"):
        hip_index(config, ("trunk", "hip"))
