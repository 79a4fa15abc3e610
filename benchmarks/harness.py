"""What all benchmarks share: the row that they give, work in turn, libraries that may be missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from statistics import median
from time import process_time
from typing import Any

from trunk_core.errors import TrunkError

Work = Callable[[], object]


class BenchError(TrunkError):
    """A benchmark that cannot be done: why, and what to do."""


@dataclass(frozen=True)
class Row:
    """A comparison: medians over the rounds, of both sides and of their ratio in each round."""

    name: str
    ours: float
    theirs: float
    unit: str
    ratio: float | None  # of the two, in the order that the name gives; None: of zeros
    goal: str = ""  # empty: for information only
    met: bool | None = None

    @classmethod
    def of(
        cls,
        name: str,
        ours: Sequence[float],
        theirs: Sequence[float],
        unit: str = "s",
        at_most: float | None = None,
        at_least: float | None = None,
        inverse: bool = False,
    ) -> Row:
        """Compare rounds by ours over theirs, ``inverse``: theirs over ours; in a unit of ``_SCALES``."""
        pairs = [(b, a) if inverse else (a, b) for a, b in zip(ours, theirs, strict=True)]
        ratio = median(a / b for a, b in pairs) if all(b for _, b in pairs) else None
        scale = _SCALES.get(unit, 1.0)
        goal, met = "", None
        if ratio is not None and at_most is not None:
            goal, met = f"<= {at_most:g}", ratio <= at_most
        elif ratio is not None and at_least is not None:
            goal, met = f">= {at_least:g}", ratio >= at_least
        return cls(name, scale * median(ours), scale * median(theirs), unit, ratio, goal, met)


_SCALES = {"ms": 1e3, "us": 1e6, "ns": 1e9}  # of times in s


def alternately(rounds: int, runs: int, *works: Work) -> list[list[float]]:
    """Return the processor times of pieces of work, s for each of their runs, round by round."""
    times: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for work, some in zip(works, times, strict=True):
            some.append(timed(work) / runs)
    return times


def timed(work: Work) -> float:
    """Return the processor time of a piece of work, s."""
    start = process_time()
    work()
    return process_time() - start


def library(module: str, package: str, requirements: str) -> Any:
    """Return a library's module. Raises BenchError if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        message = f"{package} is not installed; install it with: pip install {requirements}"
        raise BenchError(message) from None
