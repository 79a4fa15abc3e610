"""Sensor noise: standard normal samples that depend on the seed and the step alone; the normal distribution.

Raw 64-bit integers of PCG64, whose stream NumPy guarantees, become normal samples by the inverse of the
normal distribution. So the samples have the same bits on every machine and with every version of NumPy.

Pure: the distribution, its inverse and `standard_normal` are scalar functions, built on `elementary`, which
CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from trunk_core.compiled import twin
from trunk_core.elementary import exp, log

# Numerators and denominators of the three ranges, the highest power first.
_CENTRAL = (
    2509.0809287301227,
    33430.57558358813,
    67265.7709270087,
    45921.95393154987,
    13731.69376550946,
    1971.5909503065513,
    133.14166789178438,
    3.3871328727963665,
)
_CENTRAL_BELOW = (
    5226.495278852854,
    28729.085735721943,
    39307.89580009271,
    21213.794301586597,
    5394.196021424751,
    687.1870074920579,
    42.31333070160091,
    1.0,
)
_TAIL = (
    0.0007745450142783414,
    0.022723844989269184,
    0.2417807251774506,
    1.2704582524523684,
    3.6478483247632045,
    5.769497221460691,
    4.630337846156546,
    1.4234371107496835,
)
_TAIL_BELOW = (
    1.0507500716444169e-09,
    0.0005475938084995345,
    0.015198666563616457,
    0.14810397642748008,
    0.6897673349851,
    1.6763848301838038,
    2.053191626637759,
    1.0,
)
_FAR = (
    2.0103343992922881e-07,
    2.7115555687434876e-05,
    0.0012426609473880784,
    0.026532189526576124,
    0.29656057182850487,
    1.7848265399172913,
    5.463784911164114,
    6.657904643501103,
)
_FAR_BELOW = (
    2.0442631033899397e-15,
    1.421511758316446e-07,
    1.8463183175100548e-05,
    0.0007868691311456133,
    0.014875361290850615,
    0.1369298809227358,
    0.599832206555888,
    1.0,
)


_SERIES_TO = 3.0  # beyond, in the tails, a continued fraction; both have converged by then
_FRACTION_TERMS = 60


def _ratio(r: float, above: tuple[float, ...], below: tuple[float, ...]) -> float:
    numerator, denominator = above[0], below[0]
    for i in range(1, len(above)):
        numerator = numerator * r + above[i]
        denominator = denominator * r + below[i]
    return numerator / denominator


def upper_quantile(p: float) -> float:
    """Return the x > 0 that a standard normal variable exceeds with probability ``0 < p < 1/2``.

    Relative error about 1e-16. Source: M. J. Wichura, "Algorithm AS 241: the percentage points of the
    normal distribution", Applied Statistics 37 (1988), PPND16.
    """
    q = 0.5 - p
    if q <= 0.425:
        return q * _ratio(0.180625 - q * q, _CENTRAL, _CENTRAL_BELOW)
    r = sqrt(-log(p))
    if r <= 5.0:
        return _ratio(r - 1.6, _TAIL, _TAIL_BELOW)
    return _ratio(r - 5.0, _FAR, _FAR_BELOW)


def quantile(p: float) -> float:
    """Return the x below which a standard normal variable is with probability p; -inf at 0, inf at 1."""
    if p <= 0.0:
        return -inf
    if p >= 1.0:
        return inf
    return -upper_quantile(p) if p < 0.5 else upper_quantile(1.0 - p)


def probability_below(x: float) -> float:
    """Return the probability that a standard normal variable is below x.

    ::

        Phi(x) = 1/2 + phi(x) (x + x^3 / 3 + x^5 / (3 5) + ...)             for |x| <= 3
        Phi(x) = phi(x) / (-x + 1 / (-x + 2 / (-x + 3 / ...)))              for x < -3
        Phi(x) = 1 - Phi(-x)                                                for x > 3

    with ``phi(x) = exp(-x^2 / 2) / sqrt(2 pi)``; relative error below 3e-13 down to x = -30. Source:
    G. Marsaglia, "Evaluating the normal distribution", Journal of Statistical Software 11 (2004); the
    fraction is Laplace's.
    """
    if x > _SERIES_TO:
        return 1.0 - probability_below(-x)
    if x < -37.5:  # less than the smallest float; also -inf
        return 0.0
    density = exp(-0.5 * x * x) / sqrt(2.0 * pi)
    if x < -_SERIES_TO:
        fraction = -x
        for n in range(_FRACTION_TERMS, 0, -1):
            fraction = n / fraction - x
        return density / fraction
    term = total = x
    n = 1
    while abs(term) > 1e-17 * abs(total):
        n += 2
        term *= x * x / n
        total += term
    return 0.5 + density * total


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
