"""A body's constants as parameters, of the plant and of a controller's model of it."""

from __future__ import annotations

from typing import Any

from ..mechanics import MOST_HARMONICS, Body, harmonics_of
from .declarations import parameter

_DEFAULTS = {**Body()._asdict(), "hip_mode": "passive", "cosines": (), "sines": ()}
_SERIES = {
    "unit": "m",
    "minimum": -1e3,
    "maximum": 1e3,
    "element": float,
    "longest": MOST_HARMONICS,
}
_WORDS: dict[str, tuple[str, dict[str, Any]]] = {
    "hip_mass": ("Mass M of the hip", {"unit": "kg", "above": 0.0, "maximum": 1e6}),
    "trunk_mass": ("Mass m of the trunk", {"unit": "kg", "above": 0.0, "maximum": 1e6}),
    "length": (
        "Distance l from hip to centre of mass",
        {"unit": "m", "above": 0.0, "maximum": 1e3},
    ),
    "gravity": ("Gravity g", {"unit": "m/s^2", "minimum": 0.0, "maximum": 1e3}),
    "amplitude": (
        "Amplitude A of the path A sin(kx)",
        {"unit": "m", "minimum": -1e3, "maximum": 1e3},
    ),
    "wavenumber": (
        "Wave number k of the path",
        {"unit": "rad/m", "minimum": 0.0, "maximum": 1e3},
    ),
    "cosines": ("Coefficients a_n of a_n cos(n k x), n = 1, 2 ..., added to the path", _SERIES),
    "sines": ("Coefficients b_n of b_n sin(n k x), n = 1, 2 ..., added to the path", _SERIES),
    "hip_mode": (
        "passive: the hip rolls freely on its path; prescribed: it keeps its horizontal speed",
        {"choices": ("passive", "prescribed")},
    ),
}


def body_of(config: Any, as_printed: bool = False) -> Body:
    """Return the body that a configuration describes, by the fields that `body_parameter` has made."""
    return Body(
        config.hip_mass,
        config.trunk_mass,
        config.length,
        config.gravity,
        config.amplitude,
        config.wavenumber,
        config.hip_mode == "prescribed",
        as_printed,
        harmonics_of(config.cosines, config.sines),
    )


def body_parameter(name: str, field: str, believed: bool = False) -> Any:
    """Return the declaration, as parameter ``name``, of a `Body`'s field or of what determines one.

    The latter are ``hip_mode``, and the path's ``cosines`` and ``sines``.
    ``believed``: it belongs to a controller's model of the body, which may be wrong.
    """
    description, limits = _WORDS[field]
    if believed:
        description = f"{description} (of the controller's model)"
    return parameter(name, _DEFAULTS[field], description, **limits)
