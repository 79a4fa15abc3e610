"""What a check of a law returns, and what it is given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from trunk_control.law import Law, Sample
from trunk_control.limits import Limits


class LawFinding(NamedTuple):
    """A breach of the contract by a law, or a note about it."""

    check: str
    function: str  # MODULE.FUNCTION
    problem: str  # with the input that shows it
    advice: str  # what to do
    note: bool = False  # True: for information, nothing to fix

    def line(self) -> str:
        """Return it as one line."""
        return f"{self.check}: {self.function}: {self.problem}: {self.advice}"


@dataclass(frozen=True)
class LawCheck:
    """A check: its name, what it asserts, and its function of a law."""

    name: str
    asserts: str
    run: Callable[[Law], Iterator[LawFinding]]


def name_of(function: Any) -> str:
    """Return a function's module and name."""
    return f"{function.__module__}.{function.__qualname__}"


class Driven:
    """A law driven sample by sample, its default configuration within given limits."""

    def __init__(self, law: Law, limit: float = 50.0, **changes: Any) -> None:
        self.law = law
        self.config = law.config(u_clamp_min=-limit, u_clamp_max=limit, **changes)
        self.limits: Limits = self.config.limits
        self.constants = self.config.constants
        self.memory: Any = law.memory

    def update(self, sample: Sample) -> Any:
        """Return the terms of an update."""
        self.memory, terms = self.law.update(self.memory, sample, self.constants, self.limits)
        return terms

    def run(self, samples: list[Sample]) -> list[Any]:
        """Return the terms of updates with these samples."""
        return [self.update(sample) for sample in samples]


def numbers_in(record: Any) -> Iterator[float]:
    """Yield the numbers of a record, nested ones too."""
    if isinstance(record, tuple | list):
        for part in record:
            yield from numbers_in(part)
    elif isinstance(record, int | float):
        yield float(record)


def finite(record: Any) -> bool:
    """Return True if all numbers of a record are finite."""
    return all(map(isfinite, numbers_in(record)))


def given(sample: Sample) -> str:
    """Return a sample as a phrase."""
    return (
        f"reference {sample.reference!r}, measurement {sample.measurement!r}, rate {sample.rate!r}, "
        f"dt {sample.dt!r}"
    )
