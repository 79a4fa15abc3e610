"""Sensor noise: standard normal samples that depend on the seed and the step alone.

Raw 64-bit integers of PCG64, whose stream NumPy guarantees, become normal samples by the inverse of the
normal distribution. So the samples have the same bits on every machine and with every version of NumPy.

Pure: `standard_normal` is a function of an integer, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trunk_msgs_util.compiled import twin
from trunk_msgs_util.normal import upper_quantile

_UNIT = 2.0**-53
_BLOCK = 512  # steps
_WORTH_COMPILING = 20_000  # samples


def standard_normal(bits: int) -> float:
    """Return the standard normal sample of 53 random bits; at most 8.3 sigma.

    The highest 52 bits m give a probability ``p = (m + 1/2) 2^-53`` in (0, 1/2), exact in a double, and
    ``x = -quantile(p)``; the lowest bit gives the sign.
    """
    x = upper_quantile((float(bits >> 1) + 0.5) * _UNIT)
    return x if bits & 1 else -x


def random_bits(seed: int, first: int, steps: int) -> NDArray[np.int64]:
    """Return the bits of ``steps`` steps from ``first`` on [steps, 2]: the highest 53 of each raw integer."""
    generator = np.random.PCG64(seed)
    generator.advance(2 * first)
    raw = generator.random_raw(2 * steps).reshape(steps, 2)
    return (raw >> np.uint64(11)).astype(np.int64)


def noise_samples(seed: int, steps: int, first: int = 0) -> NDArray[np.float64]:
    """Return the samples of ``steps`` steps from ``first`` on [steps, 2], for position and velocity."""
    bits = random_bits(seed, first, steps)
    samples = np.empty(bits.shape)
    fill_rows = fill if bits.size < _WORTH_COMPILING else twin(fill)
    fill_rows(bits.reshape(-1), samples.reshape(-1))
    return samples


def fill(bits: NDArray[np.int64], samples: NDArray[np.float64]) -> None:
    """Fill ``samples`` [N] with those of the random bits [N]."""
    for i in range(len(bits)):
        samples[i] = standard_normal(bits[i])


class Noise:
    """The samples of a seed, step by step; the random bits are drawn in blocks."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._first = -1
        self._bits: list[list[int]] = []

    def pair(self, step: int) -> tuple[float, float]:
        """Return a step's samples for position and velocity."""
        first = step - step % _BLOCK
        if first != self._first:
            self._first, self._bits = first, random_bits(self.seed, first, _BLOCK).tolist()
        position, velocity = self._bits[step - first]
        return standard_normal(position), standard_normal(velocity)
