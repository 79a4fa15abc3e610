"""The simulator's and the disturbance's parameters: defaults and refusals."""

from __future__ import annotations

from math import inf, nan, pi

import pytest

from trunk_msgs_util.mechanics import Body
from trunk_msgs_util.parameters.declarations import ParameterError, build, values_of
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.plant import PlantState


def test_defaults_are_those_of_the_model():
    config = SimulatorConfig()
    assert config.body == Body(2.0, 0.5, 1.0, 9.81, 1.0, 1.0, False)
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
    config = build(SimulatorConfig, values)
    assert config.body == Body(
        *(3.0, 4.0, 5.0, 6.0, 7.0, 8.0), prescribed=True, harmonics=(0.5, 0.25, 0.0, -1.0)
    )
    assert config.initial_state == PlantState(1.0, 2.0, 3.0, 4.0)


@pytest.mark.parametrize("config", [SimulatorConfig, DisturbanceConfig])
def test_values_rebuild_their_configuration(config):
    assert build(config, values_of(config())) == config()


@pytest.mark.parametrize("names", [[], ["recorder"], ["disturbance", "reference"]])
def test_in_lockstep_commands_are_waited_for(names):
    assert build(SimulatorConfig, {"wait_for": names}).wait_for == tuple(names)
    with pytest.raises(ParameterError, match=r"'wait_for': \[.*\] is not allowed: effort_command"):
        build(SimulatorConfig, {"wait_for": names, "lockstep.enabled": True})


@pytest.mark.parametrize("name", ["path.cosines", "path.sines"])
def test_a_path_has_at_most_32_harmonics(name):
    assert len(build(SimulatorConfig, {name: [0.1] * 32}).body.harmonics) == 64
    with pytest.raises(ParameterError, match=f"'{name}'.* double array of at most 32"):
        build(SimulatorConfig, {name: [0.1] * 33})


@pytest.mark.parametrize(
    ("config", "name", "value", "allowed"),
    [
        (SimulatorConfig, "update_rate", 0.0, "double, >= 0.001 and <= 1e+06"),
        (SimulatorConfig, "plant.trunk_mass", -0.5, "double, > 0 and <= 1e+06"),
        (SimulatorConfig, "plant.gravity", nan, "finite double, >= 0 and <= 1000"),
        (SimulatorConfig, "plant.length", "long", "double, > 0 and <= 1000"),
        (SimulatorConfig, "substeps", 0, "integer, >= 1 and <= 10000"),
        (SimulatorConfig, "substeps", 2.0, "integer, >= 1 and <= 10000"),
        (SimulatorConfig, "hip.mode", "walking", "string, one of passive, prescribed"),
        (SimulatorConfig, "initial.position", [0.0], "double array of 2"),
        (SimulatorConfig, "initial.velocity", [0.0, nan], "finite double array of 2"),
        (SimulatorConfig, "path.cosines", [0.1, nan], "finite double array of at most 32"),
        (SimulatorConfig, "path.sines", [0.1, -1e4], "double array of at most 32, each >= -1000"),
        (SimulatorConfig, "max_effort", 0.0, "double, > 0"),
        (SimulatorConfig, "wait_for", ["nobody"], "string array, each one of effort_command"),
        (SimulatorConfig, "plant.masss", 1.0, "no such parameter; did you mean 'plant.hip_mass'?"),
        (SimulatorConfig, "plant.mass", 1.0, "'plant.hip_mass' or 'plant.trunk_mass'?"),
        (SimulatorConfig, "link.loss", 1.0, "did you mean 'link.state.loss' or "),
        (
            DisturbanceConfig,
            "pulse.start_times",
            [-1.0],
            "double array of at most 10000, each >= 0",
        ),
        (DisturbanceConfig, "pulse.start_times", {1: 2, 3: 4}, "double array of at most 10000"),
        (DisturbanceConfig, "pulse.channel", "head", "string, one of hip_effort, trunk_effort"),
        (DisturbanceConfig, "noise.components", 0, "integer, >= 1 and <= 4096"),
        (
            DisturbanceConfig,
            "noise.high_frequency",
            0.25,
            "greater than noise.low_frequency (0.5)",
        ),
    ],
)
def test_a_bad_value_is_refused_by_name_value_and_what_is_allowed(config, name, value, allowed):
    with pytest.raises(ParameterError) as caught:
        build(config, {name: value})
    assert caught.value.name == name
    message = str(caught.value)
    assert message.startswith(f"parameter {name!r}: {value!r} is not allowed: ")
    assert allowed in message
