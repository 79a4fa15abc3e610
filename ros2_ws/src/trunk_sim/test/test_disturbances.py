"""Pulses sample by sample and at random times, the sine, a table, noise that follows band and seed."""

from math import pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.units import nanoseconds, period_ns
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import (
    Disturbance,
    disturbance_at,
    multisine,
    noise_components,
    pulse,
    random_starts,
)

RATES = [1000.0, 200.0]


def pulsed_stamps(config: DisturbanceConfig, rate: float, duration: float = 10.0) -> list[int]:
    period = period_ns(rate)
    steps = nanoseconds(duration) // period
    signals = config.signals
    stamps = (k * period for k in range(steps + 1))
    return [t for t in stamps if disturbance_at(t, signals) != Disturbance()]


@pytest.mark.parametrize(
    ("start", "length", "count_1khz", "count_200hz"),
    [
        (1.0, 0.1, 100, 20),
        (0.0, 0.1, 100, 20),
        (0.1 + 0.2, 0.1, 100, 20),  # 0.30000000000000004 s
        (1.1, 0.1 * 3, 300, 60),  # 0.30000000000000004 s long
        (4.35, 0.7, 700, 140),  # 4.35 * 1e9 is no whole number in doubles
        (1.0005, 0.1, 100, 20),  # between two samples
        (2.0000001, 0.1, 100, 20),
        (1.0, 0.0333, 34, 7),  # ends between two samples
        (1.0, 0.0004, 1, 1),  # shorter than a period, on a sample
        (1.0002, 0.0004, 0, 0),  # shorter than a period, between two
        (1.0, 0.0, 0, 0),
    ],
)
def test_pulse_lasts_exact_samples(start, length, count_1khz, count_200hz):
    config = DisturbanceConfig(pulse_start_times=(start,), pulse_duration=length)
    assert [len(pulsed_stamps(config, rate)) for rate in RATES] == [count_1khz, count_200hz]


@pytest.mark.parametrize("rate", RATES, ids="{:g}Hz".format)
def test_fig8_pulses_start_and_end_on_their_stamps(rate):
    config = DisturbanceConfig(pulse_start_times=(1.0, 5.0))
    period = period_ns(rate)
    expected = [
        *range(1_000_000_000, 1_100_000_000, period),
        *range(5_000_000_000, 5_100_000_000, period),
    ]
    assert pulsed_stamps(config, rate) == expected


@given(start=st.integers(0, 10**10), steps=st.integers(0, 500), rate=st.sampled_from(RATES))
def test_pulse_of_whole_periods_lasts_as_many_samples(start, steps, rate):
    period = period_ns(rate)
    first = start // period
    stamps = [k * period for k in range(first, first + steps + 3)]
    assert sum(pulse(t, (start,), steps * period, 1.0) for t in stamps) == steps


def test_pulse_times_are_rounded_to_whole_nanoseconds():
    signals = DisturbanceConfig(pulse_start_times=(1.001, 0.1 + 0.2), pulse_duration=1.003).signals
    assert signals.pulse_starts == (1_001_000_000, 300_000_000)  # 1.001 * 1e9 falls short
    assert signals.pulse_duration == 1_003_000_000


def test_overlapping_pulses_do_not_add():
    assert pulse(150, (100, 120), 100, 2.5) == 2.5


@pytest.mark.parametrize(
    ("channel", "field"),
    [
        ("hip_effort", "hip_force"),
        ("trunk_effort", "trunk_torque"),
        ("hip_position", "hip_offset"),
        ("trunk_position", "trunk_offset"),
    ],
)
@pytest.mark.parametrize("signal", ["pulse", "sine", "noise", "table"])
def test_a_signal_acts_on_its_channel_alone(signal, channel, field):
    on = {
        "pulse": {"pulse_start_times": (0.0,), "pulse_magnitude": 3.0},
        "sine": {"sine_amplitude": 3.0, "sine_phase": 1.0},
        "noise": {"noise_rms": 3.0},
        "table": {"table_times": (0.0,), "table_values": (3.0,)},
    }
    config = DisturbanceConfig(**on[signal], **{f"{signal}_channel": channel})
    acting = disturbance_at(10_000_000, config.signals)._asdict()
    assert acting.pop(field) != 0.0
    assert set(acting.values()) == {0.0}


def test_signals_on_one_channel_add():
    config = DisturbanceConfig(
        pulse_channel="trunk_effort",
        pulse_start_times=(0.0,),
        pulse_magnitude=5.0,
        sine_channel="trunk_effort",
        sine_amplitude=2.0,
        sine_frequency=3.0,
        sine_phase=0.25,
        noise_channel="trunk_effort",
        noise_rms=1.0,
        table_channel="trunk_effort",
        table_times=(0.0, 0.04),
        table_values=(0.0, 8.0),
    )
    signals = config.signals
    noise = multisine(
        0.02, signals.noise_amplitude, signals.noise_frequencies, signals.noise_phases
    )
    expected = 5.0 + 2.0 * sin(2.0 * pi * 3.0 * 0.02 + 0.25) + noise + 4.0
    assert disturbance_at(20_000_000, signals).trunk_torque == pytest.approx(expected, rel=1e-14)


def test_sine_has_its_amplitude_frequency_and_phase():
    config = DisturbanceConfig(sine_amplitude=2.0, sine_frequency=0.5, sine_phase=pi / 2.0)
    quarter = 500_000_000
    forces = [disturbance_at(k * quarter, config.signals).hip_force for k in range(5)]
    assert forces == pytest.approx([2.0, 0.0, -2.0, 0.0, 2.0], abs=1e-14)


def noise(seed: int, duration: float = 400.0, rate: float = 50.0) -> np.ndarray:
    components = noise_components(2.0, 0.5, 5.0, 32, seed)
    return np.array([multisine(k / rate, *components) for k in range(int(duration * rate))])


def test_noise_is_a_function_of_its_seed():
    assert noise_components(2.0, 0.5, 5.0, 32, seed=7) == noise_components(
        2.0, 0.5, 5.0, 32, seed=7
    )
    assert noise_components(2.0, 0.5, 5.0, 32, seed=7) != noise_components(
        2.0, 0.5, 5.0, 32, seed=8
    )


def test_noise_of_seed_1_stays_what_it_was():
    amplitude, frequencies, phases = noise_components(2.0, 0.5, 5.0, 32, seed=1)
    assert (amplitude, frequencies[0], phases[0]) == (0.5, 0.5719749159734736, 3.9175016711702146)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_has_its_root_mean_square(seed):
    assert np.sqrt(np.mean(noise(seed) ** 2)) == pytest.approx(2.0, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_spectrum_stays_inside_its_band(seed):
    samples = noise(seed)
    power = np.abs(np.fft.rfft(samples * np.blackman(len(samples)))) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1.0 / 50.0)
    inside = (frequency > 0.5 - 0.02) & (frequency < 5.0 + 0.02)
    assert power[~inside].sum() < 1e-6 * power.sum()
    thirds = [power[(frequency >= f) & (frequency < f + 1.5)].sum() for f in (0.5, 2.0, 3.5)]
    assert min(thirds) > 0.2 * sum(thirds)  # and fills it


@given(st.integers(0, 2**31 - 1), st.integers(1, 64), st.floats(0.0, 10.0), st.floats(0.1, 10.0))
def test_each_part_of_the_band_has_one_frequency(seed, count, low, width):
    _, frequencies, phases = noise_components(1.0, low, low + width, count, seed)
    parts = [(f - low) / width * count for f in frequencies]
    assert all(i - 1e-6 <= part <= i + 1 + 1e-6 for i, part in enumerate(parts))
    assert min(frequencies) >= low
    assert all(0.0 <= phase < 2.0 * pi for phase in phases)


def test_no_noise_without_an_rms():
    assert multisine(1.0, *noise_components(0.0, 0.5, 5.0, 32, seed=1)) == 0.0


def test_random_pulses_of_seed_1_stay_where_they_were():
    config = DisturbanceConfig(
        pulse_start_times=(3.0,),
        pulse_random_count=2,
        pulse_random_from=1.0,
        pulse_random_until=2.0,
    )
    assert config.active
    assert DisturbanceConfig(pulse_random_count=1).active
    assert config.signals.pulse_starts == (3_000_000_000, 1_511_821_625, 1_950_463_696)


@given(st.integers(0, 2**31 - 1), st.integers(0, 50), st.floats(0.0, 1e3), st.floats(0.0, 1e3))
def test_random_starts_ascend_between_their_ends_and_follow_their_seed(seed, count, begin, span):
    starts = random_starts(count, begin, begin + span, seed)
    assert len(starts) == count
    assert list(starts) == sorted(starts)
    assert all(begin <= start <= begin + span for start in starts)
    assert starts == random_starts(count, begin, begin + span, seed)


def test_random_starts_are_spread_evenly():
    starts = np.array(random_starts(10_000, 2.0, 4.0, seed=5))
    expected = np.linspace(2.0, 4.0, len(starts))
    assert np.abs(starts - expected).max() < 2.0 * 1.63 / 100.0  # Kolmogorov, 1 %
    assert not set(starts) & set(random_starts(10_000, 2.0, 4.0, seed=6))


@pytest.mark.parametrize(
    ("interpolation", "expected"),
    [("linear", [0.0, 4.0, 3.0, 2.0, 2.0]), ("hold", [0.0, 4.0, 4.0, 2.0, 2.0])],
)
def test_a_table_begins_at_its_first_time_and_stays_after_its_last(interpolation, expected):
    config = DisturbanceConfig(
        table_times=(1.0, 3.0), table_values=(4.0, 2.0), table_interpolation=interpolation
    )
    assert config.active
    stamps = [999_999_999, *(k * 1_000_000_000 for k in (1, 2, 3, 9))]
    assert [disturbance_at(t, config.signals).trunk_torque for t in stamps] == expected


def test_a_table_of_zeros_does_nothing():
    assert not DisturbanceConfig(table_times=(1.0,), table_values=(0.0,)).active
