"""The simulator's and the disturbance's parameters: defaults and refusals."""

from math import inf, pi

import pytest

from trunk_core.mechanics import Body
from trunk_core.parameters.declarations import build, values_of
from trunk_sim.config import TrunkSimulator
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.plant import PlantState
from trunk_sim.plants.trunk import prescribed


def test_defaults_are_those_of_the_model():
    config = TrunkSimulator()
    assert config.constants == Body(2.0, 0.5, 1.0, 9.81, 1.0, 1.0)
    assert config.initial_state == PlantState(0.0, pi / 6.0, 1.0, 0.0)
    assert (config.max_effort, config.delay_steps) == (inf, 0)
    assert config.sensor == (0.0, 0.0, 0.0, 0.0, None)
    assert config.plant.actuator is None


def test_default_pulse_is_that_of_the_paper():
    config = DisturbanceConfig(pulse_start_times=(1.0, 5.0))
    expected = Disturbance(trunk_offset=100.0 * pi / 180.0)
    assert disturbance_at(1_050_000_000, config.signals) == expected


def test_nothing_disturbs_by_default():
    signals = DisturbanceConfig().signals
    assert {disturbance_at(k * 5_000_000, signals) for k in range(2000)} == {Disturbance()}


def test_every_parameter_reaches_the_plant():
    values = {
        "plant.hip_mass": 3.0,
        "plant.trunk_mass": 4,  # a whole number means 4.0
        "plant.length": 5.0,
        "plant.gravity": 6.0,
        "path.amplitude": 7.0,
        "path.wavenumber": 8.0,
        "path.cosines": [0.5],
        "path.sines": [0.25, -1],
        "hip.mode": "prescribed",
        "initial.position": [1.0, 2.0],
        "initial.velocity": [3.0, 4.0],
    }
    config = build(TrunkSimulator, values)
    assert config.constants == Body(
        *(3.0, 4.0, 5.0, 6.0, 7.0, 8.0), harmonics=(0.5, 0.25, 0.0, -1.0)
    )
    assert config.accelerations is prescribed
    assert config.initial_state == PlantState(1.0, 2.0, 3.0, 4.0)


@pytest.mark.parametrize("config", [TrunkSimulator, DisturbanceConfig])
def test_values_rebuild_their_configuration(config):
    assert build(config, values_of(config())) == config()


@pytest.mark.parametrize("name", ["path.cosines", "path.sines"])
def test_a_path_has_at_most_32_harmonics(name):
    assert len(build(TrunkSimulator, {name: [0.1] * 32}).constants.harmonics) == 64
