"""The simulation's clock, limits, sensors and failures."""

from dataclasses import replace
from math import inf, nan

import pytest

from trunk_sim.config import TrunkSimulator
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState, advance
from trunk_sim.plants.trunk import passive
from trunk_sim.simulation import DivergedError, Simulation
from trunk_sim.step import SensorParameters, sense

QUIET = Disturbance()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "period_ns"),
    [(200.0, 5_000_000), (1000.0, 1_000_000), (60.0, 16_666_667), (700.0, 1_428_571)],
)
def test_stamp_is_the_step_times_the_period_exactly(rate, period_ns):
    simulation = Simulation(TrunkSimulator(update_rate=rate))
    stamps = []
    for _ in range(500):
        stamps.append((simulation.truth().stamp_ns, simulation.measure(QUIET).stamp_ns))
        simulation.step(0.0, QUIET)
    assert stamps == [(k * period_ns, k * period_ns) for k in range(500)]


def test_step_integrates_over_the_period_with_every_input():
    config = TrunkSimulator(update_rate=60.0, substeps=4)
    simulation = Simulation(config)
    simulation.step(2.0, Disturbance(hip_force=3.0, trunk_torque=-0.5, trunk_offset=1.0))
    expected = advance(config.initial_state, 3.0, 1.5, 16_666_667e-9, 4, config.constants, passive)
    assert simulation.state == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_saturated_effort_drives_the_plant_and_is_reported(sign):
    limited = Simulation(TrunkSimulator(max_effort=3.0))
    limited.step(sign * 50.0, QUIET)
    exact = Simulation(TrunkSimulator())
    exact.step(sign * 3.0, QUIET)
    assert limited.state == exact.state
    assert limited.truth().effort == limited.measure(QUIET).effort == (0.0, sign * 3.0)


def test_disturbance_torque_is_not_limited_by_the_actuator():
    limited = Simulation(TrunkSimulator(max_effort=3.0))
    limited.step(3.0, Disturbance(trunk_torque=10.0))
    exact = Simulation(TrunkSimulator())
    exact.step(13.0, QUIET)
    assert limited.state == exact.state


def test_the_offset_acts_on_the_measurement_only():
    simulation, other = Simulation(TrunkSimulator()), Simulation(TrunkSimulator())
    pulse = Disturbance(trunk_offset=1.5, hip_offset=0.25)
    measured = simulation.measure(pulse)
    truth = simulation.truth()
    assert measured.position == (truth.position[0] + 0.25, truth.position[1] + 1.5)
    assert measured.velocity == truth.velocity
    simulation.step(1.0, pulse)
    other.step(1.0, QUIET)
    assert simulation.truth() == other.truth()


@pytest.mark.parametrize(("delay", "steps"), [(0.0124, 2), (0.0126, 3), (0.002, 0)])
def test_sensor_delay_is_rounded_to_whole_periods(delay, steps):
    simulation = Simulation(TrunkSimulator(delay=delay))  # periods of 5 ms
    true, seen = [], []
    for _ in range(10):
        true.append(simulation.truth().position)
        seen.append(simulation.measure(QUIET).position)
        simulation.step(0.0, QUIET)
    assert seen == [true[max(0, k - steps)] for k in range(10)]


def test_runs_with_the_same_seed_are_the_same():
    def measurements(seed):
        config = TrunkSimulator(seed=seed, position_noise=0.01, velocity_noise=0.1)
        simulation = Simulation(config)
        for _ in range(50):
            yield simulation.measure(QUIET)
            simulation.step(0.0, QUIET)

    assert list(measurements(3)) == list(measurements(3))
    assert list(measurements(3)) != list(measurements(4))


@pytest.mark.parametrize("effort", [1e308, -inf, nan], ids=str)
def test_divergence_is_an_error_that_keeps_the_state(effort):
    simulation = Simulation(TrunkSimulator(update_rate=200.0))
    simulation.step(0.0, QUIET)
    before = simulation.truth()
    with pytest.raises(DivergedError, match=r"diverged in the step after t = 0\.005 s"):
        simulation.step(effort, QUIET)
    assert simulation.truth() == before


def test_masses_that_underflow_in_a_product_diverge():
    tiny = 5e-324
    simulation = Simulation(TrunkSimulator(hip_mass=tiny, trunk_mass=tiny, length=0.1))
    with pytest.raises(DivergedError, match="the loop is unstable"):
        simulation.step(1.0, QUIET)


def test_reset_restores_the_state_and_keeps_the_time():
    config = TrunkSimulator(delay=0.02)
    simulation = Simulation(config)
    for _ in range(20):
        simulation.measure(QUIET)
        simulation.step(1.0, QUIET)
    simulation.reset()
    assert simulation.state == config.initial_state
    assert simulation.stamp_ns == 20 * 5_000_000
    assert simulation.truth().effort == (0.0, 0.0)
    assert simulation.measure(QUIET).position == config.initial_position


def test_retune_changes_the_plant_and_keeps_the_state():
    config = TrunkSimulator()
    simulation, expected = Simulation(config), Simulation(config)
    for _ in range(10):
        simulation.step(0.0, QUIET)
        expected.step(0.0, QUIET)
    heavy = replace(config, trunk_mass=5.0, position_bias=0.5, max_effort=1.0)
    simulation.reconfigure(heavy)
    assert simulation.truth() == expected.truth()
    assert simulation.measure(QUIET).position[1] == simulation.state.theta + 0.5
    state = simulation.state
    simulation.step(2.0, QUIET)
    assert simulation.state == advance(state, 0.0, 1.0, 0.005, 1, heavy.constants, passive)


def test_angles_beyond_the_largest_are_named():
    start = {"initial_position": (0.0, 1.646e6), "initial_velocity": (0.0, 2e5)}
    simulation = Simulation(TrunkSimulator(hip_mode="prescribed", **start))
    simulation.step(0.0, QUIET)
    with pytest.raises(DivergedError, match="the largest angle whose sine is computed"):
        simulation.step(0.0, QUIET)


STATE = PlantState(1.0, 0.25, 0.5, -2.0)


def test_bias_and_noise_act_on_the_trunk():
    parameters = SensorParameters(0.5, 0.25, 0.125, -1.0)
    seen = sense(STATE, Disturbance(), 2.0, -4.0, parameters)
    assert seen == (1.0, 0.25 + 0.125 + 0.5 * 2.0, 0.5, -2.0 - 1.0 + 0.25 * -4.0)
