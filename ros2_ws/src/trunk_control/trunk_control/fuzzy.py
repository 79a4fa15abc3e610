"""Fuzzy inference over (e, e_dot): triangles that sum to one, product inference, centre average.

With such a partition at most four rules fire, and the centre average is a bilinear interpolation in the
rule table: one evaluation takes microseconds and need not visit all rules, 49 or 4096.

Pure: scalar functions of floats and tuples, which CPython runs and numba compiles unchanged (there the
tuples of peaks and consequents may be arrays).
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple

from trunk_core.elementary import exp


class FuzzyRules(NamedTuple):
    """A rule base for the three outputs Kp', Kd' and alpha.

    ``*_peaks``: strictly increasing peaks of the triangles, in the inputs' units (rad, rad/s).
    ``kp``, ``kd``, ``alpha``: the rules' centres, row by row: ``table[i * len(rate_peaks) + j]`` belongs
    to the i-th label of e and the j-th of e_dot.
    """

    error_peaks: Sequence[float]
    rate_peaks: Sequence[float]
    kp: Sequence[float]  # centres in [0, 1]; as printed 0 and 1: S, B
    kd: Sequence[float]  # likewise
    alpha: Sequence[float]  # centres above 0; as printed 2 to 5: S MS M B
    logarithmic: bool = False  # Kp', Kd' by Zhao's logarithmic memberships


def locate(value: float, peaks: Sequence[float]) -> tuple[int, float]:
    """Return ``(i, w)``: value lies between peaks i and i+1, with weight w on i+1 and 1 - w on i.

    A value outside the universe is clamped to its ends. The two weights are the memberships of the
    triangles; all others are zero, and they sum to one.
    """
    last = len(peaks) - 1
    if not value > peaks[0]:  # true for NaN as well
        return 0, 0.0
    if value >= peaks[last]:
        return last - 1, 1.0
    low = 0
    while value >= peaks[low + 1]:  # too few for bisection to pay off
        low += 1
    left = peaks[low]
    return low, (value - left) / (peaks[low + 1] - left)


def logarithmic_value(weight: float, center: float) -> float:
    """Return the consequent at which Zhao's logarithmic membership reaches ``weight``.

    ::

        S (center 0): e^(-4 w)        B (center 1): 1 - e^(-4 w)

    A centre c between 0 and 1 has (1 - c) of the first and c of the second.
    """
    return center + (1.0 - 2.0 * center) * exp(-4.0 * weight)


def bilinear(table: Sequence[float], corner: int, columns: int, a: float, b: float) -> float:
    """Return the centre average over the four cells at index ``corner``.

    ``a`` is the weight of the second row, ``b`` that of the second column. In this form rounding
    cannot push the value past the centres 0 and 1, or past alpha's 2 and 5; a sum of products can.
    """
    below = corner + columns
    first = table[corner]
    first += b * (table[corner + 1] - first)
    second = table[below]
    second += b * (table[below + 1] - second)
    return first + a * (second - first)


def logarithmic_average(
    table: Sequence[float], corner: int, columns: int, a: float, b: float
) -> float:
    """Return the same average with each consequent taken at its rule's weight (`logarithmic_value`)."""
    below = corner + columns
    w11 = a * b
    w10 = a - w11
    w01 = b - w11
    w00 = 1.0 - a - w01
    return (
        w00 * logarithmic_value(w00, table[corner])
        + w01 * logarithmic_value(w01, table[corner + 1])
        + w10 * logarithmic_value(w10, table[below])
        + w11 * logarithmic_value(w11, table[below + 1])
    )


def infer(error: float, error_rate: float, rules: FuzzyRules) -> tuple[float, float, float]:
    """Return ``(Kp', Kd', alpha)`` by product inference and centre average.

    ::

        y(e, e_dot) = sum_ij mu_i(e) mu_j(e_dot) c_ij / sum_ij mu_i(e) mu_j(e_dot)

    where the denominator is 1 and only four terms of the numerator differ from 0. Linear consequents
    are the centres themselves; with ``rules.logarithmic`` those of Kp' and Kd' depend on the firing
    weight (`logarithmic_value`). Kp' and Kd' lie in [0, 1].
    """
    i, a = locate(error, rules.error_peaks)
    j, b = locate(error_rate, rules.rate_peaks)
    columns = len(rules.rate_peaks)
    corner = i * columns + j
    if rules.logarithmic:
        kp = logarithmic_average(rules.kp, corner, columns, a, b)
        kd = logarithmic_average(rules.kd, corner, columns, a, b)
    else:
        kp = bilinear(rules.kp, corner, columns, a, b)
        kd = bilinear(rules.kd, corner, columns, a, b)
    return kp, kd, bilinear(rules.alpha, corner, columns, a, b)


def cell_kind(*tables: str) -> type[Any]:
    """Return the named tuple of the four rules around an operating point, and where they fire.

    ``error_from`` <= e < ``error_to``, likewise the rate. A cell at the edge reaches to infinity, but its
    peaks (``*_left``, ``*_right``) do not. Then follow the four centres of each table, row by row.
    """
    edges = "error_from error_to rate_from rate_to error_left error_right rate_left rate_right"
    centers = (f"{table}_{place}" for table in tables for place in ("00", "01", "10", "11"))
    return namedtuple("Cell", [*edges.split(), *centers])


FuzzyCell = cell_kind("kp", "kd", "alpha")


def cell_edges(
    error: float, error_rate: float, error_peaks: Sequence[float], rate_peaks: Sequence[float]
) -> tuple[tuple[float, float, float, float, float, float, float, float], int]:
    """Return range and peaks of the cell that contains the inputs, and the index of its first rule.

    In the order of `cell_kind`: a cell at the edge holds without end.
    """
    i, _ = locate(error, error_peaks)
    j, _ = locate(error_rate, rate_peaks)
    edges = (
        error_peaks[i] if i > 0 else -inf,
        error_peaks[i + 1] if i < len(error_peaks) - 2 else inf,
        rate_peaks[j] if j > 0 else -inf,
        rate_peaks[j + 1] if j < len(rate_peaks) - 2 else inf,
        error_peaks[i],
        error_peaks[i + 1],
        rate_peaks[j],
        rate_peaks[j + 1],
    )
    return edges, i * len(rate_peaks) + j


def four_rules(
    table: Sequence[float], corner: int, columns: int
) -> tuple[float, float, float, float]:
    """Return the centres of the rules of the cell at index ``corner``, row by row."""
    below = corner + columns
    return table[corner], table[corner + 1], table[below], table[below + 1]


def cell_at(error: float, error_rate: float, rules: FuzzyRules) -> Any:
    """Return the cell of the rule base that contains the inputs."""
    edges, corner = cell_edges(error, error_rate, rules.error_peaks, rules.rate_peaks)
    columns = len(rules.rate_peaks)
    return FuzzyCell(
        *edges,
        *four_rules(rules.kp, corner, columns),
        *four_rules(rules.kd, corner, columns),
        *four_rules(rules.alpha, corner, columns),
    )


def rules_of(cell: Any, rules: FuzzyRules) -> FuzzyRules:
    """Return a rule base of only the cell's four rules: within the cell `infer` gives the same bits."""
    return FuzzyRules(cell[4:6], cell[6:8], cell[8:12], cell[12:16], cell[16:20], rules.logarithmic)


class FiredRule(NamedTuple):
    """A rule's cell (i-th label of e, j-th of e_dot), its weight, and its consequents at that weight."""

    row: int
    column: int
    weight: float
    values: tuple[float, ...]  # in the order of the outputs


def fired_at(
    error: float, error_rate: float, error_peaks: Sequence[float], rate_peaks: Sequence[float]
) -> tuple[FiredRule, ...]:
    """Return the four rules that fire, without consequents; for display, not for the loop.

    Their weights sum to 1; at a peak of a triangle some of them are 0.
    """
    i, a = locate(error, error_peaks)
    j, b = locate(error_rate, rate_peaks)
    w11 = a * b
    w01 = b - w11
    return (
        FiredRule(i, j, 1.0 - a - w01, ()),
        FiredRule(i, j + 1, w01, ()),
        FiredRule(i + 1, j, a - w11, ()),
        FiredRule(i + 1, j + 1, w11, ()),
    )


def fired_rules(error: float, error_rate: float, rules: FuzzyRules) -> tuple[FiredRule, ...]:
    """Return the four rules whose weighted consequents (Kp', Kd', alpha) `infer` adds up."""
    fired = []
    for rule in fired_at(error, error_rate, rules.error_peaks, rules.rate_peaks):
        cell = rule.row * len(rules.rate_peaks) + rule.column
        kp, kd = rules.kp[cell], rules.kd[cell]
        if rules.logarithmic:
            kp, kd = logarithmic_value(rule.weight, kp), logarithmic_value(rule.weight, kd)
        fired.append(rule._replace(values=(kp, kd, rules.alpha[cell])))
    return tuple(fired)
