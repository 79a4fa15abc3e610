"""The sensors' memory and noise: past states for the delay, seeded samples.

Pure: no ROS, no clock; the noise is a function of the seed and the step only.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from .plant import PlantState


class DelayLine:
    """The true state a whole number of steps ago; until there are that many, the oldest known one."""

    def __init__(self, steps: int) -> None:
        self._line: deque[PlantState] = deque(maxlen=steps + 1)

    def push(self, state: PlantState) -> PlantState:
        """Append the latest state and return the delayed one."""
        self._line.append(state)
        return self._line[0]

    def clear(self) -> None:
        """Forget the past."""
        self._line.clear()


def noise_samples(seed: int, steps: int) -> NDArray[np.float64]:
    """Return the samples of a `NoiseStream`'s first steps [steps, 2]."""
    return np.random.Generator(np.random.PCG64(seed)).standard_normal((steps, 2))


class NoiseStream:
    """Pairs of standard normal samples, one pair per step, from NumPy's PCG64 with a seed.

    Drawn in blocks; the values do not depend on the block size.
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
