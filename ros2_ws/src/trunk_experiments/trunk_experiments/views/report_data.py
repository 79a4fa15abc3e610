"""A report page's plots and animation as plain values: columns, surfaces, rule use."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trunk_control.rule_base import RuleBaseConfig
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.units import NANOSECONDS
from trunk_sim.config import SimulatorConfig

from ..analysis.parameter_text import changed_parameters
from ..recorded.inputs import Pulse
from .own_terms import OwnTerm, gains_told, own_terms, values_of_term
from .packing import Columns, packed, packed_columns
from .run_view import INPUTS, RunView, labels, off_scale

if TYPE_CHECKING:
    from trunk_msgs_util.recording.joint_table import Floats

_SURFACE_POINTS = 61  # per side, at least: seven evenly spaced peaks fall on grid points
_MOST_TEXT = 6_000_000  # characters of all columns; beyond it they are rounded
_EXACT_ROWS = 150_000  # more are not even tried: they do not fit
_MOST_MARKS = 40
_BITS = (24, 20, 16)  # of a curve's usual range; 16 are 30 times what a screen can show
_STRETCHES = 16  # by which the size of long columns is judged
CHANNEL_TEXTS = {  # what a pulse acts on, its unit
    "hip_effort": ("on the hip", "N"),
    "trunk_effort": ("on the trunk", "N·m"),
    "hip_position": ("on the measured hip position", "m"),
    "trunk_position": ("on the measured angle", "°"),
}


def report_data(views: Sequence[RunView]) -> dict[str, Any]:
    """Return the data of all runs, ready for JSON.

    Columns are exact to the last bit while that makes a small page; of long runs they are rounded to as many
    `bits` of a curve's usual range as fit.
    """
    own = own_terms(views)
    columns = [_columns(view, own) for view in views]
    updates = [_updates(view) for view in views]
    rows = sum(len(view.table.t) for view in views)
    parts = [*columns, *updates]
    for bits in (None, *_BITS) if rows <= _EXACT_ROWS else _likely_bits(parts):
        texts = [
            [packed_columns(part, bits) for part in run]
            for run in zip(columns, updates, strict=True)
        ]
        if sum(_size(part) for run in texts for part in run) <= _MOST_TEXT:
            break
    return {
        "runs": [
            _run(view, label, *text)
            for view, label, text in zip(views, labels(views), texts, strict=True)
        ],
        "own": [{"id": f"own-{term.name}", "name": term.name, "unit": term.unit} for term in own],
        "gains": gains_told(views),
        "bits": bits,
    }


def _likely_bits(parts: Sequence[dict[str, Floats]]) -> tuple[int, ...]:
    """Return the bits with which long columns will fit, most first, judged by a tenth of their rows."""

    def stretches(values: Floats) -> Floats:
        length = len(values) // (10 * _STRETCHES)
        starts = (k * len(values) // _STRETCHES for k in range(_STRETCHES))
        return np.concatenate([values[start : start + length] for start in starts])

    few = [{name: stretches(values) for name, values in part.items()} for part in parts]
    for k, bits in enumerate(_BITS):
        if 10 * sum(_size(packed_columns(part, bits)) for part in few) <= _MOST_TEXT:
            return _BITS[k:]
    return _BITS[-1:]


def _size(columns: Columns) -> int:
    """Return the number of characters that columns take."""
    return sum(len(column.get("packed", "")) for column in columns.values())


def _columns(view: RunView, own: Sequence[OwnTerm]) -> dict[str, Floats]:
    """Return the columns shown of the states, by name; angles in degrees."""
    table = view.table
    # Another robot is drawn as a pendulum on a fixed pivot.
    x = np.zeros_like(table.x) if view.run.another_robot else table.x
    return {
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


def _run(view: RunView, label: str, columns: Columns, updates: Columns) -> dict[str, Any]:
    controller = view.controller
    low, high = view.limits
    amplitude, wavenumber, harmonics = view.hip_path
    if view.run.another_robot:
        amplitude, harmonics = 0.0, None
    return {
        "label": label,
        "title": view.title,
        "columns": columns,
        "limits": [low if isfinite(low) else None, high if isfinite(high) else None],
        "path": {
            "amplitude": amplitude,
            "wavenumber": wavenumber,
            "harmonics": harmonics or (),
            "length": (view.simulator or SimulatorConfig()).length,
        },
        "pushes": _pushes(view),
        "pulses": [{"start": p.start, "end": p.end, "text": pulse_text(p)} for p in view.pulses],
        "fell": _fell(view),
        "branch": None if view.run.branch is None else view.run.branch.at,
        "changed": _changed(view),
        "turns": [turn._asdict() for turn in view.turns],
        "torqueRange": off_scale(view.table.torque),
        "fuzzy": _surfaces(controller, updates) if isinstance(controller, RuleBaseConfig) else None,
    }


def _changed(view: RunView) -> list[dict[str, object]]:
    """Return the parameters that were changed while the run went on; nothing where marks hide the curves."""
    changes = changed_parameters(view.run)
    return [
        {"t": c.t, "text": f"{c.node}: {c.name} {c.words}"}
        for c in (changes if len(changes) <= _MOST_MARKS else ())
    ]


def _fell(view: RunView) -> float | None:
    """Return when the trunk fell, in s since the run's start; None if it did not."""
    fell_ns = view.recording.fell_at_ns
    return None if fell_ns is None else (fell_ns - view.run.begin_ns) / NANOSECONDS


def pulse_text(pulse: Pulse) -> str:
    """Return the effect of a pulse as text: ``+100° on the measured angle``."""
    where, unit = CHANNEL_TEXTS[pulse.channel]
    value = degrees(pulse.magnitude) if unit == "°" else pulse.magnitude
    return f"{value:+.4g}{'' if unit == '°' else ' '}{unit} {where}"


def _pushes(view: RunView) -> list[dict[str, float]]:
    """Return the spans in which an operator pushed, in s, with the greatest force [N] and torque [N m]."""
    try:
        operated = view.run.operated
    except RecordingError:  # the warnings say what is wrong with them
        return []
    if not operated:
        return []
    t = view.table.t
    acts = operated.over(np.rint(t * NANOSECONDS).astype(np.int64) + view.run.begin_ns)
    edges = np.flatnonzero(np.diff(acts.any(axis=1), prepend=False, append=False))
    return [
        {
            "start": float(t[first]),
            "end": float(t[min(after, len(t) - 1)]),
            "force": float(np.abs(acts[first:after, 0]).max()),
            "torque": float(np.abs(acts[first:after, 1]).max()),
        }
        for first, after in edges.reshape(-1, 2).tolist()
    ]


def _updates(view: RunView) -> dict[str, Floats]:
    """Return the stamps [s], errors [degrees] and rates [rad/s] that were the inputs of the inference."""
    if view.terms is None:
        return {}
    error, rate = (view.terms.column(*column) for column in INPUTS)
    return {
        "t": (view.terms.stamp_ns - view.run.begin_ns) / NANOSECONDS,
        "error": np.degrees(error),
        "rate": rate,
    }


class Surface(NamedTuple):
    """What a rule base infers on a grid over its universe."""

    errors: Floats  # rad
    rates: Floats  # rad/s
    values: Floats  # [rate, error, output]


def surface_of(config: RuleBaseConfig) -> Surface:
    """Return the values that the rules of a controller infer, on a grid from its first peaks to its last."""
    errors, rates = (
        np.linspace(peaks[0], peaks[-1], max(_SURFACE_POINTS, 2 * len(peaks) - 1), dtype=np.float64)
        for peaks in config.peaks
    )
    infer = config.inference
    grid = [[infer(e, r) for e in errors.tolist()] for r in rates.tolist()]
    return Surface(errors, rates, np.array(grid))


def _surfaces(config: RuleBaseConfig, updates: Columns) -> dict[str, Any]:
    surface = surface_of(config)
    outputs = [
        {
            "id": table.name,
            "values": packed(surface.values[:, :, i].ravel()),
            "range": None if table.name == "alpha" else table.numbers[:2],
        }
        for i, table in enumerate(config.tables)
    ]
    error_peaks, rate_peaks = config.peaks
    return {
        "error": packed(np.degrees(surface.errors)),
        "rate": packed(surface.rates),
        "outputs": outputs,
        "errorPeaks": [degrees(peak) for peak in error_peaks],
        "ratePeaks": list(rate_peaks),
        "errorLabels": list(config.axes.error),
        "rateLabels": list(config.axes.rate),
        "updates": updates,
    }
