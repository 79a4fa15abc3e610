"""Sensors: delay, bias, seeded noise and the disturbance's offset on the measured trunk and hip.

Pure: no ROS, no clock; the noise is a function of the seed and the step alone.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from .disturbances import Disturbance
from .plant import PlantState


class SensorParameters(NamedTuple):
    """Standard deviations and biases of the measured trunk angle [rad] and rate [rad/s]."""

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    position_bias: float = 0.0
    velocity_bias: float = 0.0


class Measurement(NamedTuple):
    """What the sensors say: m, rad, m/s, rad/s."""

    x: float
    theta: float
    x_dot: float
    theta_dot: float


def measure(
    state: PlantState,
    disturbance: Disturbance,
    position_sample: float,
    velocity_sample: float,
    p: SensorParameters,
) -> Measurement:
    """Return ``true + offset + bias + sigma n`` for the trunk, with standard normal samples n.

    ``state`` is the true state that the sensors see now, already delayed. The hip carries its offset alone.
    """
    return Measurement(
        state.x + disturbance.hip_offset,
        state.theta
        + disturbance.trunk_offset
        + p.position_bias
        + p.position_noise * position_sample,
        state.x_dot,
        state.theta_dot + p.velocity_bias + p.velocity_noise * velocity_sample,
    )


class DelayLine:
    """The true state some whole steps ago; before the first has passed, the oldest known one."""

    def __init__(self, steps: int) -> None:
        self._line: deque[PlantState] = deque(maxlen=steps + 1)

    def push(self, state: PlantState) -> PlantState:
        """Append the newest state and return the delayed one."""
        self._line.append(state)
        return self._line[0]

    def clear(self) -> None:
        """Forget the past."""
        self._line.clear()


class NoiseStream:
    """Pairs of standard normal samples, one pair per step, from NumPy's PCG64 with a seed.

    Drawn in blocks; the values do not depend on the block's size.
    """

    _BLOCK = 1024

    def __init__(self, seed: int) -> None:
        self._generator = np.random.Generator(np.random.PCG64(seed))
        self._samples: list[list[float]] = []

    def next_pair(self) -> tuple[float, float]:
        """Return the next step's samples for position and velocity."""
        if not self._samples:
            self._samples = self._generator.standard_normal((self._BLOCK, 2)).tolist()
            self._samples.reverse()
        position, velocity = self._samples.pop()
        return position, velocity
