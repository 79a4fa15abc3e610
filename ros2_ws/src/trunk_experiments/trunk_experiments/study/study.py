"""A study: which runs a sweep makes. `file` reads one, `design` and `bases` make its runs."""

from __future__ import annotations

from dataclasses import dataclass

from .draws import Distribution

Scalar = bool | int | float | str
HOWS = ("value", "factor", "offset")
SPACINGS = ("linear", "log")
MAX_RUNS = 100_000_000
# Columns of the results besides the variables.
RESERVED = ("run", "controller", "point", "draw", "seed", "status", "reason", "diverged_at_s")


@dataclass(frozen=True)
class Target:
    """One parameter of a node, or of whichever controller runs; ``index`` for an array's element."""

    node: str  # "controller" means the one that runs
    name: str
    index: int | None = None

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
