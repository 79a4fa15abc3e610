"""Sensors: delay, bias, noise, offsets."""

from __future__ import annotations

import pytest

from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.sensors import DelayLine
from trunk_sim.step import SensorParameters, sense

STATE = PlantState(1.0, 0.25, 0.5, -2.0)


def test_perfect_sensors_show_the_true_state():
    assert sense(STATE, Disturbance(), 1.7, -0.4, SensorParameters()) == STATE


def test_bias_and_noise_act_on_the_trunk():
    parameters = SensorParameters(0.5, 0.25, 0.125, -1.0)
    seen = sense(STATE, Disturbance(), 2.0, -4.0, parameters)
    assert seen == (1.0, 0.25 + 0.125 + 0.5 * 2.0, 0.5, -2.0 - 1.0 + 0.25 * -4.0)


def test_offsets_act_on_positions_only():
    disturbance = Disturbance(hip_force=9.0, trunk_torque=9.0, hip_offset=0.5, trunk_offset=1.75)
    seen = sense(STATE, disturbance, 0.0, 0.0, SensorParameters())
    assert seen == (1.5, 2.0, 0.5, -2.0)


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_delay_is_whole_steps(steps):
    line = DelayLine(steps)
    states = [PlantState(float(k), 0.0, 0.0, 0.0) for k in range(8)]
    seen = [line.push(state) for state in states]
    assert seen == [states[max(0, k - steps)] for k in range(8)]


def test_a_cleared_delay_starts_afresh():
    line = DelayLine(2)
    line.push(STATE)
    line.clear()
    other = STATE._replace(x=5.0)
    assert line.push(other) == other
