"""Seeded draws: each variable has its own stream, so that adding one changes no other's values.

Numbers between 0 and 1 become values by functions of our own (`elementary`, `normal`): a study draws the
same on every machine.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from trunk_msgs_util.elementary import exp, log
from trunk_msgs_util.normal import probability_below, quantile
from trunk_msgs_util.recording.joint_arrays import Floats

from ..errors import DrawError

_SMALLEST = 2.0**-54  # instead of 0, at which a normal variable is -inf
# What each needs, and what it may have.
DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "uniform": (("low", "high"), ()),
    "loguniform": (("low", "high"), ()),
    "normal": (("mean", "std"), ("low", "high")),
    "integers": (("low", "high"), ()),
    "choice": (("values",), ()),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution by name; ``low`` and ``high`` truncate a normal one, integers include both ends."""

    kind: str
    values: tuple[Any, ...] = ()
    low: float = -inf
    high: float = inf
    mean: float = 0.0
    std: float = 0.0

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise DrawError(f"low {self.low:g} is above high {self.high:g}")
        if self.kind == "loguniform" and self.low <= 0.0:
            raise DrawError(f"low is {self.low:g}: a number > 0 is needed")
        if self.kind == "normal" and self.std <= 0.0:
            raise DrawError(f"std is {self.std:g}: a number > 0 is needed")
        if self.kind == "integers" and (self.low % 1.0 or self.high % 1.0):
            raise DrawError(f"low {self.low:g} and high {self.high:g} must be whole numbers")

    def draw(self, count: int, seed: int, name: str) -> list[Any]:
        """Return ``count`` values of the stream of a seed and a name.

        A longer draw starts with the same values.
        """
        generator = stream(seed, name)
        if self.kind == "integers":
            whole: list[Any] = generator.integers(
                int(self.low), int(self.high), count, endpoint=True
            ).tolist()
            return whole
        return self.at(generator.random(count))

    def at(self, u: Floats) -> list[Any]:
        """Return the values at some fractions, 0 <= u < 1, of the distribution."""
        if self.kind == "integers":
            whole = np.floor(u * (self.high - self.low + 1.0)) + self.low
            return [int(number) for number in whole]
        if self.kind == "choice":
            return [self.values[int(i)] for i in u * len(self.values)]
        if self.kind == "uniform":
            drawn = self.low + (self.high - self.low) * u
        elif self.kind == "loguniform":
            low, high = log(self.low), log(self.high)
            drawn = np.array([exp(low + (high - low) * fraction) for fraction in u.tolist()])
        else:
            below, above = (
                probability_below((end - self.mean) / self.std) for end in (self.low, self.high)
            )
            p = below + (above - below) * np.maximum(u, _SMALLEST)
            drawn = self.mean + self.std * np.array(
                [quantile(probability) for probability in p.tolist()]
            )
        values: list[Any] = np.clip(drawn, self.low, self.high).tolist()
        return values


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of a variable: PCG64, seeded by the study's seed and the variable's name."""
    words = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4").tolist()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *words])))
