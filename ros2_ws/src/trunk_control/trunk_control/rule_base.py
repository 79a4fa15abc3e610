"""The parameters that laws with rule tables share: both inputs' universes, triangles and labels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import pi
from typing import Any

from trunk_core.parameters.declarations import ParameterError, parameter

from .fuzzy import FiredRule
from .law import ControllerConfig
from .rule_tables import FEWEST, MOST, Axes, Range, RuleTable, check_labels, input_labels

EVEN_PEAKS = tuple(i / 3.0 for i in range(-3, 4))


def labels_parameter(name: str, default: tuple[str, ...], description: str) -> Any:
    """Return the declaration of labels."""
    least = 1 if default else 0
    return parameter(name, default, description, element=str, shortest=least, longest=MOST)


def centers_parameter(
    name: str, default: tuple[float, ...], description: str, **limits: Any
) -> Any:
    """Return the declaration of the centres of labels, as many as these."""
    return parameter(name, default, description, shortest=1, longest=MOST, **limits)


def table_parameter(name: str, default: tuple[str, ...], description: str) -> Any:
    """Return the declaration of a rule table."""
    row = "one row for each label of e"
    return parameter(
        name, default, description, shortest=FEWEST, longest=MOST, each=row, table=True
    )


def _peaks(name: str, of: str) -> Any:
    return parameter(
        name,
        EVEN_PEAKS,
        f"Peaks of {of} triangles, as fractions of the universe, ascending",
        shortest=FEWEST,
        longest=MOST,
        minimum=-1.0,
        maximum=1.0,
    )


@dataclass(frozen=True)
class RuleBaseConfig(ControllerConfig):
    """The inputs of a rule base: where the triangles of e and of e_dot have their peaks, and their labels."""

    error_range: float = parameter(
        "fuzzy.error_range", pi / 2.0, "Universe of e: +- this", unit="rad", above=0.0, maximum=1e3
    )
    rate_range: float = parameter(
        "fuzzy.rate_range", 5.0, "Universe of e_dot: +- this", unit="rad/s", above=0.0, maximum=1e5
    )
    error_peaks: tuple[float, ...] = _peaks("fuzzy.error_peaks", "e's")
    rate_peaks: tuple[float, ...] = _peaks("fuzzy.rate_peaks", "e_dot's")
    error_labels: tuple[str, ...] = labels_parameter(
        "fuzzy.error_labels",
        (),
        "Labels of e, one for each peak; none: the usual ones of 3, 5, 7 or 9 peaks, else E1, E2 ...",
    )
    rate_labels: tuple[str, ...] = labels_parameter(
        "fuzzy.rate_labels",
        (),
        "Labels of e_dot, one for each peak; none: the usual ones of 3, 5, 7 or 9 peaks, else R1, R2 ...",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for peaks, name in (
            (self.error_peaks, "fuzzy.error_peaks"),
            (self.rate_peaks, "fuzzy.rate_peaks"),
        ):
            if any(b <= a for a, b in pairwise(peaks)):
                raise ParameterError(name, peaks, "strictly increasing peaks")
        axes = self.axes
        for table in self.tables:
            try:
                table.values(axes)
            except ValueError as error:
                raise ParameterError(f"rules.{table.name}", table.rows, str(error)) from None

    @staticmethod
    def table_labels(values: Mapping[str, object]) -> Axes:
        """Return the labels of the tables' rows and columns, from values of all parameters (`with_cells`).

        Raises ParameterError for labels that do not fit the peaks.
        """
        return Axes(
            *(
                _labels(f"fuzzy.{axis}_labels", values[f"fuzzy.{axis}_labels"], peaks, letter)
                for axis, letter in (("error", "E"), ("rate", "R"))
                for peaks in [values[f"fuzzy.{axis}_peaks"]]
            )
        )

    @property
    def axes(self) -> Axes:
        """The labels of e and of e_dot."""
        return Axes(
            _labels("fuzzy.error_labels", self.error_labels, self.error_peaks, "E"),
            _labels("fuzzy.rate_labels", self.rate_labels, self.rate_peaks, "R"),
        )

    @property
    def tables(self) -> tuple[RuleTable, ...]:
        """The tables ``rules.*``, in the order of the outputs; each law defines them."""
        raise NotImplementedError

    @property
    def inference(self) -> Callable[[float, float], tuple[float, ...]]:
        """The value of each table as a function of e in rad and e_dot in rad/s; each law defines it."""
        raise NotImplementedError

    def fired(self, error: float, rate: float) -> tuple[FiredRule, ...]:
        """Return the four rules that fire at e in rad and e_dot in rad/s; each law defines it."""
        raise NotImplementedError

    @property
    def peaks(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The peaks of e in rad and of e_dot in rad/s."""
        return (
            tuple(self.error_range * peak for peak in self.error_peaks),
            tuple(self.rate_range * peak for peak in self.rate_peaks),
        )


def _labels(name: str, given: Any, peaks: Any, letter: str) -> tuple[str, ...]:
    """Return the labels of an input's peaks (`input_labels`). Raises ParameterError naming the parameter."""
    try:
        return input_labels(tuple(given), len(peaks), letter)
    except (TypeError, ValueError) as error:
        raise ParameterError(name, given, str(error)) from None


@lru_cache(maxsize=256)
def rule_table(
    name: str,
    rows: tuple[str, ...],
    labels: tuple[str, ...],
    values: tuple[float, ...],
    numbers: Range,
    output: str = "",
) -> RuleTable:
    """Return the table ``rules.NAME`` with the labels and centres of ``fuzzy.NAME_labels`` and ``_centers``.

    ``output``: in place of NAME in the names of these two parameters.

    Raises ParameterError for labels that cannot be, and for another number of centres.
    """
    output = output or name
    try:
        check_labels(labels)
    except ValueError as error:
        raise ParameterError(f"fuzzy.{output}_labels", labels, str(error)) from None
    if len(values) != len(labels):
        raise ParameterError(
            f"fuzzy.{output}_centers",
            values,
            f"as many as fuzzy.{output}_labels ({len(labels)}: {', '.join(labels)})",
        )
    return RuleTable(name, rows, dict(zip(labels, values, strict=True)), numbers)
