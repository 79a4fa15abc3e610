"""What a drive and a joint's friction do, against oracles that share no code with them."""

from fractions import Fraction
from math import exp, inf, nextafter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.mechanics import Body
from trunk_sim.config import TrunkSimulator
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.plants.trunk import prescribed
from trunk_sim.step import (
    STICKING,
    Actuator,
    PlantConstants,
    PlantStatus,
    Scale,
    SensorParameters,
    act,
    actuator_torque,
    approach_of,
    at_rest,
    on_second,
    quantised,
    sense,
    with_friction,
)

numbers = st.floats(-1e6, 1e6)
QUIET = Disturbance()


@given(numbers, numbers, st.floats(0.1, 1e6))
def test_neutral_constants_change_no_bit(before, effort, limit):
    plain = actuator_torque(before, effort, limit, None)
    assert actuator_torque(before, effort, limit, Actuator()).hex() == plain.hex()
    assert plain == min(max(effort, -limit), limit)


@given(st.floats(-1e9, 1e9), st.floats(1e-6, 1e3))
def test_quantising_gives_the_nearest_multiple(value, resolution):
    multiple = quantised(value, resolution)
    steps = round(multiple / resolution)
    assert abs(Fraction(multiple) - Fraction(value)) <= Fraction(resolution) * Fraction(0.5000001)
    assert multiple == resolution * steps


def test_nothing_is_quantised_where_doubles_end():
    assert quantised(1e300, 1e-300) == 1e300
    assert quantised(inf, 1.0) == inf
    assert np.isnan(quantised(float("nan"), 1.0))


@pytest.mark.parametrize(
    ("effort", "made"), [(1.9, 0.0), (-2.0, 0.0), (2.5, 0.5), (-7.0, -5.0), (0.0, 0.0)]
)
def test_a_dead_band(effort, made):
    assert actuator_torque(9.0, effort, inf, Actuator(dead_band=2.0)) == made


def test_the_order_is_as_documented():
    drive = Actuator(0.5, 3.0, 1.0, 2.0, 0.25, 0.0, 0.0)
    # 10 -> 9 (dead band) -> 10 (resolution) -> 10.25 (bias) -> 8 (limit) -> 1 + 3 (rate) -> half the way
    assert actuator_torque(1.0, 10.0, 8.0, drive) == 2.5


@given(st.floats(1e-4, 10.0), st.floats(1e-5, 1.0), st.integers(1, 50))
def test_a_lag_is_the_exponential_approach(time_constant, period, steps):
    drive = Actuator(approach=approach_of(time_constant, period))
    torque = 0.0
    for _ in range(steps):
        torque = actuator_torque(torque, 10.0, inf, drive)
    assert torque == pytest.approx(
        10.0 * (1.0 - exp(-steps * period / time_constant)), rel=1e-9, abs=1e-9
    )


def test_a_rate_limit_makes_a_ramp():
    drive = Actuator(step=0.5)
    torques = [0.0]
    for _ in range(10):
        torques.append(actuator_torque(torques[-1], -3.0, inf, drive))
    assert torques == [-0.5 * k for k in range(7)] + [-3.0] * 4


@given(st.floats(-1e3, 1e3), st.floats(0.0, 50.0), st.floats(0.0, 50.0))
def test_friction_acts_against_the_motion(rate, coulomb, viscous):
    torque = with_friction(0.0, rate, Actuator(coulomb=coulomb, viscous=viscous))
    assert torque * rate <= 0.0
    expected = viscous * abs(rate) + coulomb * min(abs(rate) / STICKING, 1.0)
    assert abs(torque) == pytest.approx(expected, rel=1e-12)


def test_friction_takes_energy_from_a_swinging_trunk():
    plant = PlantConstants(Body(amplitude=0.0), 0.001, 1, inf, inf)  # a pendulum at rest
    start = at_rest(PlantState(0.0, 3.0, 0.0, 0.0), plant)

    def fastest(plant):
        trunk, fastest = start, 0.0
        for k in range(4000):
            trunk = act(trunk, 0.0, QUIET, plant, on_second, prescribed)
            fastest = max(fastest, abs(trunk.state.theta_dot)) if k > 2500 else fastest
        return fastest

    rubbing = plant._replace(actuator=Actuator(coulomb=0.2, viscous=0.1))
    assert fastest(rubbing) < 0.9 * fastest(plant)


def test_the_torque_of_a_drive_is_reported_and_moves_the_trunk():
    plant = PlantConstants(Body(), 0.005, 1, inf, inf, Actuator(approach=0.25))
    trunk = PlantStatus(PlantState(0.0, 0.0, 1.0, 0.0), 4.0, False, False)
    after = act(trunk, 12.0, QUIET, plant, on_second, prescribed)
    assert after.effort == 6.0
    alone = act(trunk, 6.0, QUIET, plant._replace(actuator=None), on_second, prescribed)
    assert after.state == alone.state


def test_sensors_read_multiples_within_their_limits():
    scale = Scale(0.25, 0.5, 1.0, 3.0)
    state = PlantState(1.0, 0.63, 2.0, -7.9)
    seen = sense(state, QUIET, 0.0, 0.0, SensorParameters(scale=scale))
    assert seen == (1.0, 0.75, 2.0, -3.0)
    assert sense(state, QUIET, 0.0, 0.0, SensorParameters()) == (1.0, 0.63, 2.0, -7.9)
    # noise and offsets are read like everything else
    pushed = sense(
        state, Disturbance(trunk_offset=5.0), 1.0, 0.0, SensorParameters(0.1, scale=scale)
    )
    assert pushed.theta == 1.0


def test_parameters_become_constants_of_a_period():
    config = TrunkSimulator(
        update_rate=100.0,
        actuator_time_constant=0.02,
        actuator_rate_limit=500.0,
        actuator_dead_band=0.1,
        coulomb_friction=2.0,
        position_resolution=0.001,
    )
    drive = config.plant.actuator
    assert drive.approach == pytest.approx(1.0 - exp(-0.5), rel=1e-15)
    assert (drive.step, drive.dead_band, drive.coulomb, drive.viscous) == (5.0, 0.1, 2.0, 0.0)
    assert config.sensor.scale == Scale(0.001, 0.0, inf, inf)
    assert TrunkSimulator().plant.actuator is TrunkSimulator().sensor.scale is None
    assert nextafter(1.0, 0.0) < approach_of(1e-9, 1.0) <= 1.0
