"""A report page's plots and animation as plain values: columns in full precision, surfaces, rule use."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from math import degrees, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from trunk_control.fuzzy import fired_rules, infer
from trunk_control.fuzzy_pid_law import FuzzyPidConfig
from trunk_msgs_util.units import NANOSECONDS
from trunk_sim.config import SimulatorConfig

from .own_terms import OwnTerm, gains_told, own_terms, values_of_term
from .run_view import Pulse, RunView, labels, off_scale

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_arrays import Floats

_SURFACE_POINTS = 61  # per side: evenly spaced peaks fall on grid points
_CHANNELS = {  # what a pulse acts on, its unit
    "hip_effort": ("on the hip", "N"),
    "trunk_effort": ("on the trunk", "N·m"),
    "hip_position": ("on the measured hip position", "m"),
    "trunk_position": ("on the measured angle", "°"),
}


def packed(values: Floats) -> dict[str, Any]:
    """Return an array of doubles as base64 of its little-endian bytes, or as its constant.

    Every value, NaN included, comes back with the same bits (in a constant column all NaNs are alike).
    """
    data = np.ascontiguousarray(values, "<f8")
    if len(data) and (data.view("<i8") == data.view("<i8")[0]).all() and isfinite(data[0]):
        return {"constant": float(data[0]), "count": len(data)}
    return {"f8": base64.b64encode(data.tobytes()).decode("ascii")}


def report_data(views: Sequence[RunView]) -> dict[str, Any]:
    """Return the data of all runs, ready for JSON."""
    own = own_terms(views)
    return {
        "runs": [_run(view, label, own) for view, label in zip(views, labels(views), strict=True)],
        "own": [{"id": f"own-{term.name}", "name": term.name, "unit": term.unit} for term in own],
        "gains": gains_told(views),
    }


def _run(view: RunView, label: str, own: Sequence[OwnTerm]) -> dict[str, Any]:
    table, controller = view.table, view.controller
    low, high = view.limits
    amplitude, wavenumber, harmonics = view.hip_path
    x = table.x
    if view.run.another_robot:  # drawn as a pendulum on a fixed pivot
        amplitude, harmonics, x = 0.0, None, np.zeros_like(x)
    columns = {
        "t": table.t,
        "x": x,
        "theta": np.degrees(table.theta),
        "measured": np.degrees(table.theta_measured),
        "reference": np.degrees(table.reference),
        "rate": table.theta_dot,
        "torque": table.torque,
        "kp": table.kp,
        "ki": table.ki,
        "kd": table.kd,
        "alpha": table.alpha,
        **{f"own-{term.name}": values_of_term(view, term) for term in own},
    }
    return {
        "label": label,
        "title": view.title,
        "columns": {name: packed(values) for name, values in columns.items()},
        "limits": [low if isfinite(low) else None, high if isfinite(high) else None],
        "path": {
            "amplitude": amplitude,
            "wavenumber": wavenumber,
            "harmonics": harmonics or (),
            "length": (view.simulator or SimulatorConfig()).length,
        },
        "pulses": [{"start": p.start, "end": p.end, "text": pulse_text(p)} for p in view.pulses],
        "fell": _fell(view),
        "branch": None if view.run.branch is None else view.run.branch.at,
        "turns": [turn._asdict() for turn in view.turns],
        "torqueRange": off_scale(table.torque),
        "fuzzy": _surfaces(view, controller) if isinstance(controller, FuzzyPidConfig) else None,
    }


def _fell(view: RunView) -> float | None:
    """Return when the trunk fell, in s since the run's begin; None if it did not."""
    fell_ns = view.recording.fell_at_ns
    return None if fell_ns is None else (fell_ns - view.run.begin_ns) / NANOSECONDS


def pulse_text(pulse: Pulse) -> str:
    """Return what a pulse does, as text: ``+100° on the measured angle``."""
    where, unit = _CHANNELS[pulse.channel]
    value = degrees(pulse.magnitude) if unit == "°" else pulse.magnitude
    return f"{value:+.4g}{'' if unit == '°' else ' '}{unit} {where}"


def _updates(view: RunView) -> tuple[Floats, Floats, Floats]:
    """Return the stamps [s], errors [rad] and rates [rad/s] that were the inputs of the inference."""
    terms = view.terms
    return (
        (terms.stamp_ns - view.run.begin_ns) / NANOSECONDS,
        terms.column("position", "error"),
        terms.column("position", "error_rate"),
    )


def _surfaces(view: RunView, config: FuzzyPidConfig) -> dict[str, Any]:
    rules = config.rules
    errors, rates = (
        np.linspace(peaks[0], peaks[-1], _SURFACE_POINTS, dtype=np.float64)
        for peaks in (rules.error_peaks, rules.rate_peaks)
    )
    grid = np.array([[infer(e, r, rules) for e in errors.tolist()] for r in rates.tolist()])
    t, error, rate = _updates(view)
    return {
        "error": packed(np.degrees(errors)),
        "rate": packed(rates),
        "kp": packed(grid[:, :, 0].ravel()),
        "kd": packed(grid[:, :, 1].ravel()),
        "alpha": packed(grid[:, :, 2].ravel()),
        "errorPeaks": [degrees(peak) for peak in rules.error_peaks],
        "ratePeaks": list(rules.rate_peaks),
        "updates": {"t": packed(t), "error": packed(np.degrees(error)), "rate": packed(rate)},
    }


def rule_use(view: RunView) -> list[list[int]]:
    """Return how many updates fired each rule (weight above 0), [label of e][label of e_dot]."""
    config = view.controller
    if not isinstance(config, FuzzyPidConfig):
        return []
    rules = config.rules
    counts = [[0] * len(rules.rate_peaks) for _ in rules.error_peaks]
    _, errors, rates = _updates(view)
    for error, rate in zip(errors.tolist(), rates.tolist(), strict=True):
        for rule in fired_rules(error, rate, rules):
            if rule.weight > 0.0:
                counts[rule.row][rule.column] += 1
    return counts
