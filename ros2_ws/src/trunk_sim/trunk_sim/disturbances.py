"""Disturbances as functions of time: pulses, a sine, seeded band-limited noise, and a table.

Each acts on one channel: a force on the hip, a torque on the trunk, or an offset on a measured position.
All are open-loop functions of the stamp, so that a value is the same at any rate and in any process.

Pure: scalar functions of integers, floats and tuples, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from trunk_core.elementary import sine_wave
from trunk_core.samples import JointSample
from trunk_core.units import held, interpolated

CHANNELS = ("hip_effort", "trunk_effort", "hip_position", "trunk_position")


class Disturbance(NamedTuple):
    """What acts at one instant, in the order of `CHANNELS`."""

    hip_force: float = 0.0  # N
    trunk_torque: float = 0.0  # N m
    hip_offset: float = 0.0  # m, on the measurement
    trunk_offset: float = 0.0  # rad, on the measurement


class Signals(NamedTuple):
    """Four signals; ``*_channel`` is an index into `CHANNELS`, times are ns, frequencies Hz."""

    pulse_channel: int
    pulse_starts: Sequence[int]
    pulse_duration: int
    pulse_magnitude: float
    sine_channel: int
    sine_amplitude: float
    sine_frequency: float
    sine_phase: float
    noise_channel: int
    noise_amplitude: float
    noise_frequencies: Sequence[float]
    noise_phases: Sequence[float]
    table_channel: int = 0
    table_linear: bool = True  # between the rows; False: each value until the next
    table_times: Sequence[int] = ()
    table_values: Sequence[float] = ()


def pulse(t_ns: int, starts: Sequence[int], duration: int, magnitude: float) -> float:
    """Return the magnitude while ``start <= t < start + duration`` for any start, else 0."""
    for start in starts:
        if start <= t_ns < start + duration:
            return magnitude
    return 0.0


def multisine(
    t: float, amplitude: float, frequencies: Sequence[float], phases: Sequence[float]
) -> float:
    """Return ``amplitude * sum_i sin(2 pi f_i t + phi_i)``, t in s: band-limited noise."""
    total = 0.0
    for i in range(len(frequencies)):
        total += sine_wave(frequencies[i] * t, phases[i])
    return amplitude * total


def disturbance_at(t_ns: int, s: Signals) -> Disturbance:
    """Return the disturbance at a stamp in ns: for each channel, the sum of its signals.

    The table is zero before its first time; after its last it stays at its last value.
    """
    t = t_ns / 1_000_000_000
    hip_force = 0.0
    trunk_torque = 0.0
    hip_offset = 0.0
    trunk_offset = 0.0
    for signal in range(4 if len(s.table_times) > 0 else 3):
        if signal == 0:
            channel = s.pulse_channel
            value = pulse(t_ns, s.pulse_starts, s.pulse_duration, s.pulse_magnitude)
        elif signal == 1:
            channel = s.sine_channel
            value = 0.0
            if s.sine_amplitude != 0.0:
                value = s.sine_amplitude * sine_wave(s.sine_frequency * t, s.sine_phase)
        elif signal == 2:
            channel = s.noise_channel
            value = multisine(t, s.noise_amplitude, s.noise_frequencies, s.noise_phases)
        else:
            channel = s.table_channel
            if s.table_linear:
                value = interpolated(t_ns, s.table_times, s.table_values, 0.0)
            else:
                value = held(t_ns, s.table_times, s.table_values, 0.0)
        if channel == 0:
            hip_force += value
        elif channel == 1:
            trunk_torque += value
        elif channel == 2:
            hip_offset += value
        else:
            trunk_offset += value
    return Disturbance(hip_force, trunk_torque, hip_offset, trunk_offset)


def disturbance_sample(
    stamp_ns: int, joints: tuple[str, ...], disturbance: Disturbance
) -> JointSample:
    """Return the message of what acts at a stamp: per joint, effort and offset on the position."""
    return JointSample(
        stamp_ns,
        joints,
        position=(disturbance.hip_offset, disturbance.trunk_offset),
        effort=(disturbance.hip_force, disturbance.trunk_torque),
    )


def noise_components(
    rms: float, low: float, high: float, count: int, seed: int
) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """Return ``(amplitude, frequencies, phases)`` of a multisine with the given RMS in [low, high] Hz.

    One frequency is drawn uniformly in each of ``count`` equal bands, each phase in [0, 2 pi), from
    raw integers of PCG64 with the seed, whose stream NumPy guarantees. Empty where ``rms`` is 0.
    ``amplitude = rms sqrt(2 / count)``.
    """
    if rms == 0.0:
        return 0.0, (), ()
    drawn = _uniform(2 * count, seed)
    width = (high - low) / count
    frequencies = tuple(low + width * (i + drawn[i]) for i in range(count))
    phases = tuple(2.0 * pi * number for number in drawn[count:])
    return rms * sqrt(2.0 / count), frequencies, phases


def random_starts(count: int, begin: float, end: float, seed: int) -> tuple[float, ...]:
    """Return ``count`` times [s], ascending, drawn uniformly from [begin, end]: ``begin + (end - begin) u``.

    From raw integers of PCG64 with the seed, whose stream NumPy guarantees.
    """
    drawn = _uniform(count, seed) if count else []
    return tuple(sorted(begin + (end - begin) * u for u in drawn))


def _uniform(count: int, seed: int) -> list[float]:
    """Return numbers in [0, 1): the upper 53 of the 64 raw bits, times 2^-53."""
    return [(raw >> 11) * 2.0**-53 for raw in np.random.PCG64(seed).random_raw(count).tolist()]
