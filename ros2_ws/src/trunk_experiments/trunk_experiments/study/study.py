"""A study: which runs a sweep makes, a table of one row each. `file` reads one, `rows` makes its plans.

Row = ((grid point) x runs + draw) x controllers + controller: what is drawn, seeds included, depends
only on the draw, so that all controllers and all grid points meet the same conditions. Draws are seeded,
each variable's from its own stream, so that adding one changes no other's values. Numbers between 0 and 1
become values by functions of our own (`elementary`, `normal`): a study draws the same on every machine.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Any

import numpy as np

from trunk_msgs_util.elementary import exp, log
from trunk_msgs_util.normal import probability_below, quantile
from trunk_msgs_util.recording.joint_arrays import Floats

from ..errors import DrawError

Scalar = bool | int | float | str
HOWS = ("value", "factor", "offset")
SPACINGS = ("linear", "log")
MAX_RUNS = 100_000_000
# Columns of the results besides the variables.
RESERVED = ("run", "controller", "point", "draw", "seed", "status", "reason", "diverged_at_s")
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


@dataclass(frozen=True)
class Target:
    """One parameter of a node, or of whichever controller runs; ``index`` for an array's element."""

    node: str  # "controller" means the one that runs
    name: str
    index: int | None = None

    def node_with(self, contender: ContenderSpec) -> str:
        """Return the name of the node in a contender's runs."""
        return contender.node if self.node == "controller" else self.node

    def __str__(self) -> str:
        return f"{self.node}.{self.name}" + ("" if self.index is None else f"[{self.index}]")


@dataclass(frozen=True)
class Variable:
    """What varies: a column of the results. Either ``values`` (a grid) or ``distribution`` (drawn)."""

    name: str
    targets: tuple[Target, ...]
    how: str  # value: replaces the parameter; factor: multiplies it; offset: is added to it
    values: tuple[Scalar, ...] = ()
    distribution: Distribution | None = None
    written: tuple[str, ...] = ()  # its numbers with units, as in the file; the others are in SI


@dataclass(frozen=True)
class ContenderSpec:
    """One controller of the study, with its own node, parameter files and values."""

    label: str
    node: str
    params: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class StudySpec:
    """A study as read from its file; ``text`` is the file's content."""

    source: str
    text: str
    scenario: str
    contenders: tuple[ContenderSpec, ...]
    variables: tuple[Variable, ...]
    params: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    rate: float | None = None  # Hz
    duration: float | None = None  # s
    runs: int = 1  # draws per grid point
    seed: int = 1
    block: int = 480  # runs: 30 times as many as lanes

    @property
    def grid(self) -> tuple[Variable, ...]:
        """The variables with given values."""
        return tuple(v for v in self.variables if v.distribution is None)

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values of each grid variable."""
        return tuple(len(v.values) for v in self.grid)

    @property
    def total(self) -> int:
        """The number of runs in all."""
        points = 1
        for size in self.shape:
            points *= size
        return points * self.runs * len(self.contenders)


def design(study: StudySpec, first: int, last: int) -> dict[str, list[Any]]:
    """Return columns of the rows first <= row < last: run, controller, point, draw, seed, variables."""
    rows = np.arange(first, last)
    labels = [contender.label for contender in study.contenders]
    which = rows % len(labels)
    draw = rows // len(labels) % study.runs
    point = rows // (len(labels) * study.runs)
    drawn = drawn_values(study)
    places = np.unravel_index(point, study.shape) if study.shape else ()
    at = dict(zip((v.name for v in study.grid), places, strict=True))
    columns: dict[str, list[Any]] = {
        "run": rows.tolist(),
        "controller": [labels[i] for i in which],
        "point": point.tolist(),
        "draw": draw.tolist(),
        "seed": [drawn[""][i] if study.runs > 1 else None for i in draw],
    }
    for v in study.variables:
        chosen = v.values if v.distribution is None else drawn[v.name]
        columns[v.name] = [chosen[i] for i in at.get(v.name, draw)]
    return columns


@lru_cache(maxsize=1)
def drawn_values(study: StudySpec) -> dict[str, list[Any]]:
    """Return each drawn variable's values by name, and the noise seeds under an empty name."""
    values = {
        v.name: v.distribution.draw(study.runs, study.seed, v.name)
        for v in study.variables
        if v.distribution is not None
    }
    return {**values, "": stream(study.seed, "").integers(2**31, size=study.runs).tolist()}
