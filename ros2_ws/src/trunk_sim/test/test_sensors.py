"""Sensors: delay, bias, noise, offsets."""

from __future__ import annotations

import numpy as np
import pytest

from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.sensors import DelayLine, NoiseStream
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


def pairs(stream: NoiseStream, count: int) -> list[tuple[float, float]]:
    return [stream.next_pair() for _ in range(count)]


@pytest.mark.parametrize("block", [1, 7, 4096])
def test_noise_does_not_depend_on_the_blocks_size(block):
    class OtherBlock(NoiseStream):
        _BLOCK = block

    assert pairs(OtherBlock(5), 2500) == pairs(NoiseStream(5), 2500)


def test_noise_is_a_function_of_its_seed():
    assert pairs(NoiseStream(5), 10) == pairs(NoiseStream(5), 10)
    assert pairs(NoiseStream(5), 10) != pairs(NoiseStream(6), 10)


def test_noise_of_seed_1_stays_what_it_was():
    expected = np.random.Generator(np.random.PCG64(1)).standard_normal(4)
    assert np.ravel(pairs(NoiseStream(1), 2)).tolist() == expected.tolist()
    assert NoiseStream(1).next_pair() == (0.345584192064786, 0.8216181435011584)


def test_noise_is_standard_normal_and_its_two_channels_independent():
    samples = np.array(pairs(NoiseStream(1), 20_000))
    assert samples.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.03)
    assert samples.std(axis=0) == pytest.approx([1.0, 1.0], rel=0.03)
    assert np.corrcoef(samples.T)[0, 1] == pytest.approx(0.0, abs=0.03)
