"""How often each fuzzy rule fired in a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trunk_control.rule_base import RuleBaseConfig

from .run_view import INPUTS, RunView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trunk_msgs_util.recording.joint_table import Floats, Integers


_AT_ONCE = 1 << 16  # updates: those of an hour at once would take 400 MB


def rule_use(view: RunView) -> list[list[int]]:
    """Return how many updates fired each rule (weight above 0), [label of e][label of e_dot]."""
    config = view.controller
    if not isinstance(config, RuleBaseConfig) or view.terms is None:
        return []
    errors, rates = (view.terms.column(*column) for column in INPUTS)
    return times_fired(errors, rates, *config.peaks)


def times_fired(
    errors: Floats, rates: Floats, error_peaks: Sequence[float], rate_peaks: Sequence[float]
) -> list[list[int]]:
    """Return how many of the inputs [rad, rad/s] fire each rule: `fired_rules` of all at once."""
    counts = np.zeros((len(error_peaks), len(rate_peaks)), np.int64)
    for first in range(0, len(errors), _AT_ONCE):
        i, a = _located(errors[first : first + _AT_ONCE], error_peaks)
        j, b = _located(rates[first : first + _AT_ONCE], rate_peaks)
        both = a * b
        later = b - both
        for rows, columns, weights in (
            (i, j, 1.0 - a - later),
            (i, j + 1, later),
            (i + 1, j, a - both),
            (i + 1, j + 1, both),
        ):
            fired = weights > 0.0
            at = np.ravel_multi_index((rows[fired], columns[fired]), counts.shape)
            counts += np.bincount(at, minlength=counts.size).reshape(counts.shape)
    table: list[list[int]] = counts.tolist()
    return table


def places_among(values: Floats, peaks: Sequence[float]) -> Floats:
    """Return the places of inputs among the peaks: 1.25 is a quarter beyond the second."""
    low, weights = _located(values, peaks)
    return np.where(np.isnan(values), np.nan, low + weights)


def _located(values: Floats, peaks: Sequence[float]) -> tuple[Integers, Floats]:
    """Return the results of `locate` for all values at once."""
    at = np.asarray(peaks, np.float64)
    inside = np.where(values > at[0], np.minimum(values, at[-1]), at[0])  # NaN to the first peak
    low: Integers = np.minimum(np.searchsorted(at, inside, side="right") - 1, len(at) - 2)
    weights: Floats = (inside - at[low]) / (at[low + 1] - at[low])
    return low, weights
