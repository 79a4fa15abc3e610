"""The parameters that every node declares, those of the recorder, and a body's constants as parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .. import topics
from ..mechanics import MOST_HARMONICS, Body, harmonics_of
from ..plugins import Plugin, PluginError, Registry
from ..units import period_ns
from .declarations import ParameterError, parameter

PLANT_NAME = "plant.name"  # of the simulator; absent, the plant is the trunk
TRUNK = "trunk"


def plant_in(plants: Registry[Plugin], values: Mapping[str, object]) -> Plugin:
    """Return the plant that ``plant.name`` among values names.

    Raises ParameterError for one that is not installed, or cannot be used.
    """
    name = values.get(PLANT_NAME, TRUNK)
    if name not in plants.names:
        installed = ", ".join(plants.names)
        allowed = f"an installed plant ({installed}): install the package that has it"
        raise ParameterError(PLANT_NAME, name, allowed)
    try:
        return plants.named(str(name))
    except PluginError as error:
        raise ParameterError(PLANT_NAME, name, str(error)) from error


def rate_parameter(
    description: str = "Rate of the plant's steps; the period is 1/rate, rounded to whole ns",
) -> Any:
    """Return the declaration of a node's ``update_rate``."""
    return parameter(
        "update_rate", 200.0, description, unit="Hz", minimum=0.001, maximum=1e6, fixed=True
    )


def lockstep_parameter(description: str) -> Any:
    """Return the declaration of ``lockstep.enabled``, with what it makes this node do."""
    return parameter("lockstep.enabled", False, description, fixed=True)


@dataclass(frozen=True)
class ManagedConfig:
    """The parameters that every node declares: all are managed (lifecycle) nodes."""

    autostart: bool = parameter(
        "autostart",
        True,
        "Configure and activate at start; false: wait for someone to do it, e.g. with `ros2 lifecycle set`",
        fixed=True,
    )


@dataclass(frozen=True)
class PeriodicConfig(ManagedConfig):
    """The parameters of a node that does something at a rate."""

    update_rate: float = rate_parameter()

    @property
    def period_ns(self) -> int:
        """The period h in ns."""
        return period_ns(self.update_rate)


@dataclass(frozen=True)
class RecorderConfig(ManagedConfig):
    """Parameters of the ``recorder`` node."""

    output: str = parameter(
        "output",
        "",
        "File to write, NAME.mcap; empty: trunk_<UTC time>.mcap in the working directory",
        fixed=True,
    )
    overwrite: bool = parameter("overwrite", False, "Replace the file if it exists", fixed=True)
    controllers: tuple[str, ...] = parameter(
        "controllers",
        (),
        "Controllers of the plan, for the record; the ~/state of every node that publishes one is recorded",
        element=str,
        fixed=True,
    )
    scenario: str = parameter("scenario", "", "Name of the scenario, for the record", fixed=True)
    lockstep: bool = lockstep_parameter(
        "The plant waits until its states are written; messages are logged in simulated time"
    )
    lockstep_topics: tuple[str, ...] = parameter(
        "lockstep.topics",
        (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND),
        "Topics that carry one message per step; the plant waits until they are written",
        element=str,
        fixed=True,
    )

    markers: bool = parameter(
        "markers",
        False,
        "Record the run's picture too, for 3-D views: markers, tf and robot_description, 30 times a second",
        fixed=True,
    )

    @property
    def mode(self) -> str:
        """How the run keeps time, for the record."""
        return "lockstep" if self.lockstep else topics.REAL_TIME


# A body's constants, of the plant and of a controller's model of it.
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


def body_of(config: Any) -> Body:
    """Return the body that a configuration describes, by the fields that `body_parameter` has made."""
    return Body(
        config.hip_mass,
        config.trunk_mass,
        config.length,
        config.gravity,
        config.amplitude,
        config.wavenumber,
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
