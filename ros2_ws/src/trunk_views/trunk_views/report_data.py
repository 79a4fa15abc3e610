"""What a report's page plays and draws, as plain values: the runs' columns, and what happened to them."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterable, Iterator, Sequence
from math import degrees, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from trunk_core.units import NANOSECONDS
from trunk_evidence.evidence import Pulse
from trunk_evidence.parameter_text import changed_parameters, full_text
from trunk_evidence.run_metrics import SETTLING_BAND_DEG
from trunk_evidence.run_table import held_at
from trunk_msgs_util.picture.frames import Track, as_data
from trunk_recording.reader import RecordingError
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.plant import Plant
from trunk_sim.plants.trunk import PLANT

from .run_view import (
    INPUTS,
    OwnTerm,
    RunView,
    gains_told,
    labels,
    of_either_drive,
    off_scale,
    on_tracks,
    own_terms,
    plant_of,
    rule_places,
    values_of_term,
)

if TYPE_CHECKING:
    from trunk_core.arrays import Floats, Integers

_EXACT_ROWS = 150_000  # of all runs; more are reduced to bins
_BINNED_ROWS = 60_000
_DIFFERENCES = 3  # a smooth curve has half the size that its doubles have
_MOST_CHANGES = 40  # more would hide the curves


def channel_texts(plant: Plant) -> dict[str, tuple[str, str]]:
    """Return what a pulse acts on, and its unit, by channel."""
    first, second = (coordinate.joint for coordinate in plant.coordinates)
    places = (f"on the {first}", f"on the {second}", f"on the measured {first} position")
    units = (
        unit.replace("N m", "N·m").replace("rad", "°") for unit in plant.channel_units.values()
    )
    where = (*places, "on the measured angle")
    return dict(zip(plant.channels, zip(where, units, strict=True), strict=True))


def report_data(views: Sequence[RunView]) -> dict[str, Any]:
    """Return the data of all runs, ready for JSON; angles in rad.

    Columns are exact to the last bit; those of long runs hold each ``bin`` states' least and greatest value.
    """
    own, heights = own_terms(views), on_tracks(views)
    names = labels(views)
    rows = sum(len(view.table.t) for view in views)
    size = 1 if rows <= _EXACT_ROWS else -(-2 * rows // _BINNED_ROWS)
    references = [_reference(view) for view in views]
    return {
        "runs": [
            {
                "name": name if len(views) > 1 else "",
                "world": _world(view),
                "fell": _fell(view),
                "columns": packed(_columns(view, own, heights), size),
                "reference": references.index(reference),  # the first run that has the same
                "changes": [
                    (change.t, f"{change.node} {change.name}", full_text(change.after))
                    for change in changed_parameters(view.run)
                ],
                "others": _others(view),
                "measured": _differs(view.table.theta_measured, view.table.theta),
            }
            for view, name, reference in zip(views, names, references, strict=True)
        ],
        "bin": size,
        "band": SETTLING_BAND_DEG,
        "own": [{"name": term.name, "unit": term.unit} for term in own],
        "gains": gains_told(views),
        "limits": sorted({bound for view in views for bound in view.limits if isfinite(bound)}),
        "pulses": _pulses(views),
        "pushed": [[push["start"], push["end"]] for view in views for push in _pushes(view)],
        "marks": _marks(views, names),
        "words": _page_words(views),
    }


def _page_words(views: Sequence[RunView]) -> dict[str, object] | None:
    if of_either_drive(views):
        return {"first": "hip", "second": "trunk", "slides": None}
    plant = plant_of(views)
    return plant.page_words if plant else None


def packed(columns: Iterable[tuple[str, Floats]], size: int = 1) -> dict[str, Any]:
    """Return columns for JSON, equal ones once: differences of their bits, bytes of equal weight together.

    ``size``: of so many states each, the least and the greatest value are left; 1: of every state its own.
    """
    places: dict[str, int] = {}
    seen: dict[bytes, int] = {}
    distinct: list[Integers] = []
    for name, column in columns:
        values = np.ascontiguousarray(
            column if size == 1 else _extremes(column, size, name == "t"), "<f8"
        )
        places[name] = seen.setdefault(values.tobytes(), len(seen))
        if len(distinct) < len(seen):
            distinct.append(values.view("<i8"))
    bits: Integers = np.stack(distinct)
    for _ in range(_DIFFERENCES):
        bits = np.diff(bits, axis=1, prepend=np.int64(0))
    data = np.ascontiguousarray(bits).view(np.uint8).reshape(-1, 8).T.tobytes()
    return {
        "places": places,
        "count": bits.shape[1],
        "differences": _DIFFERENCES,
        "data": base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii"),
    }


def _extremes(values: Floats, size: int, times: bool) -> Floats:
    """Return each ``size`` values' least and greatest in their order, or of times the first and the last."""
    bins = -(-len(values) // size)
    rows = np.pad(values, (0, bins * size - len(values)), mode="edge").reshape(bins, size)
    if times:
        return rows[:, [0, -1]].ravel()
    gaps = np.isnan(rows)
    least = np.where(gaps, np.inf, rows).argmin(axis=1)
    most = np.where(gaps, -np.inf, rows).argmax(axis=1)
    at = np.sort(np.stack([least, most], axis=1), axis=1)
    return np.take_along_axis(rows, at, axis=1).ravel()


def _columns(view: RunView, own: Sequence[OwnTerm], tracks: bool) -> Iterator[tuple[str, Floats]]:
    """Yield the columns of the states that are shown, and their names; one at a time, as they are long."""
    table = view.table
    columns = {
        "t": table.t,
        # Another robot is drawn as a pendulum on a fixed pivot.
        "x": table.x if view.pictured else np.zeros_like(table.x),
        **({} if tracks else {"x_dot": table.x_dot}),
        "theta": table.theta,
        "theta_dot": table.theta_dot,
        "torque": table.torque,
        "reference": table.reference,
        "measurement": table.theta_measured,
        "kp": table.kp,
        "ki": table.ki,
        "kd": table.kd,
        "alpha": table.alpha,
    }
    yield from columns.items()
    for term in own:
        yield term.name, values_of_term(view, term)
    if view.terms is not None:
        at = np.rint(table.t * NANOSECONDS).astype(np.int64) + view.run.begin_ns
        active = view.acts(table.t)
        names = ("rules_e", "rules_row"), ("rules_rate", "rules_column")
        for axis, (name, place) in enumerate(names):
            yield name, held_at(at, view.terms.stamp_ns, view.terms.column(*INPUTS[axis]))
            where = held_at(at, view.terms.stamp_ns, rule_places(view, axis))
            where = np.where(active, where, np.nan)
            yield place, np.round(where, 3, out=where)  # it is only looked at


def _others(view: RunView) -> list[tuple[float, str]]:
    """Return, by the time in s from which it is so, a controller that does not act: for a branch."""
    names = (*view.controllers, *CONTROLLERS)
    return [
        (turn.start, next(name for name in names if name != turn.controller)) for turn in view.turns
    ] or [(0.0, names[0])]


def _differs(measured: Floats, true: Floats) -> bool:
    """Return True if a measured angle is anywhere visibly different from the true one."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool((np.abs(measured - true) > 2e-11).any())


def _reference(view: RunView) -> bytes:
    """Return a key that is equal for runs of one reference: its values with the times of its changes."""
    t, values = view.table.t, view.table.reference
    changes = np.flatnonzero(np.append(True, values[1:] != values[:-1]))
    return np.concatenate([t[changes], values[changes]]).tobytes()


def _world(view: RunView) -> dict[str, Any]:
    """Return the plant's picture, and the torque that it shows as half a turn."""
    picture = view.geometry.picture
    if not view.pictured:
        picture = picture._replace(track=Track())
    bounds = [abs(bound) for bound in view.limits if isfinite(bound)]
    torque = np.abs(view.table.torque[np.isfinite(view.table.torque)])
    usual = off_scale(view.table.torque) or float(torque.max(initial=0.0)) or 1.0
    return {
        "picture": as_data(picture),
        "drive": view.geometry.drive,
        "unit": view.plant.coordinates[0].unit if view.plant else "m",
        "limit": max(bounds, default=usual),
    }


def _fell(view: RunView) -> float | None:
    """Return when the trunk fell, in s since the run's start; None if it did not."""
    fall = view.run.fall
    return None if fall is None else (fall.stamp_ns - view.run.begin_ns) / NANOSECONDS


def _pulses(views: Sequence[RunView]) -> list[dict[str, Any]]:
    """Return each pulse with the runs on which it acts."""
    runs: dict[tuple[Pulse, str], list[int]] = {}
    for index, view in enumerate(views):
        for pulse in dict.fromkeys(view.pulses):
            runs.setdefault((pulse, pulse_text(pulse, view.plant or PLANT)), []).append(index)
    return [
        {"start": p.start, "end": p.end, "text": text, "runs": indices}
        for (p, text), indices in runs.items()
    ]


def pulse_text(pulse: Pulse, plant: Plant) -> str:
    """Return the effect of a pulse as text: ``+100° on the measured angle``."""
    where, unit = channel_texts(plant)[pulse.channel]
    value = degrees(pulse.magnitude) if unit == "°" else pulse.magnitude
    return f"{value:+.4g}{'' if unit == '°' else ' '}{unit} {where}"


def _marks(views: Sequence[RunView], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the events of the runs by time, with the runs' names unless all runs share them."""
    runs: dict[tuple[float, str, str], list[str]] = {}
    for view, name in zip(views, names, strict=True):
        for mark in _happened(view):
            runs.setdefault(mark, []).append(name)

    def place(mark: tuple[float, str, str]) -> tuple[float, bool, str, str]:
        """Return the order: at one time a controller's changes before other nodes'; not all have room."""
        t, kind, words = mark
        return t, kind == "change" and words.partition(":")[0] not in CONTROLLERS, kind, words

    return [
        {
            "t": t,
            "kind": kind,
            "words": words if len(whose) == len(views) else f"{words} ({', '.join(whose)})",
        }
        for (t, kind, words), whose in sorted(runs.items(), key=lambda item: place(item[0]))
    ]


def _happened(view: RunView) -> Iterator[tuple[float, str, str]]:
    """Yield time in s, kind and words of what happened in a run."""
    for turn in view.turns[1:]:
        yield turn.start, "turn", f"→ {turn.controller}"
    changes = [change for change in changed_parameters(view.run) if change.before != change.after]
    for change in changes if len(changes) <= _MOST_CHANGES else ():
        yield change.t, "change", f"{change.node}: {change.name} {change.words}"
    if view.run.branch is not None:
        yield view.run.branch.at, "branch", "branch begins"
    if (fell := _fell(view)) is not None:
        yield fell, "fell", "fell"
    for push in _pushes(view):
        force, torque = push["force"], push["torque"]
        parts = [f"{force:.3g} N"] * (force > 0.0) + [f"{torque:.3g} N·m"] * (torque > 0.0)
        yield push["start"], "push", f"push, {' and '.join(parts)}"


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
