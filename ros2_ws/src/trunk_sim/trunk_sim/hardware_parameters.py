"""The parameters of a drive, of sensors, of a network's links and of an operator; all off by default."""

from __future__ import annotations

from math import inf
from typing import Any

from trunk_msgs_util.parameters.declarations import parameter

_TORQUE = {"unit": "N m", "minimum": 0.0, "maximum": 1e6}
_ANGLE = {"unit": "rad", "minimum": 0.0, "maximum": 1e3}
_RATE = {"unit": "rad/s", "minimum": 0.0, "maximum": 1e3}
_LIMIT = {"above": 0.0, "unbounded": True}
_EITHER_WAY = {"minimum": -1e3, "maximum": 1e3}

MISSING = ("hold", "zero")
_SEED = {"minimum": 0, "maximum": 2**31 - 1, "fixed": True}
_TIME_CONSTANT = {"unit": "s", "minimum": 0.0, "maximum": 1e3}
_WORDS: dict[str, tuple[float | str, str, dict[str, Any]]] = {
    "actuator.time_constant": (0.0, "Time constant of the actuator's lag; 0: none", _TIME_CONSTANT),
    "actuator.rate_limit": (
        inf,
        "Largest rate of change of its torque",
        {"unit": "N m/s", **_LIMIT},
    ),
    "actuator.dead_band": (
        0.0,
        "Commands within +- this give no torque, larger ones are reduced by it",
        _TORQUE,
    ),
    "actuator.resolution": (
        0.0,
        "Its torque is a multiple of this, before bias and lag; 0: continuous",
        _TORQUE,
    ),
    "actuator.bias": (0.0, "Torque added to it", {**_TORQUE, "minimum": -1e6}),
    "actuator.coulomb_friction": (
        0.0,
        "Coulomb friction in the joint, against any motion",
        _TORQUE,
    ),
    "actuator.viscous_friction": (
        0.0,
        "Viscous friction in the joint, proportional to the trunk's rate",
        {**_TORQUE, "unit": "N m s/rad"},
    ),
    "sensor.position_noise": (0.0, "Standard deviation of the measured angle", _ANGLE),
    "sensor.velocity_noise": (0.0, "Standard deviation of the measured rate", _RATE),
    "sensor.position_bias": (0.0, "Bias of the measured angle", {**_ANGLE, **_EITHER_WAY}),
    "sensor.velocity_bias": (0.0, "Bias of the measured rate", {**_RATE, **_EITHER_WAY}),
    "sensor.position_resolution": (
        0.0,
        "The measured angle is a multiple of this; 0: continuous",
        _ANGLE,
    ),
    "sensor.velocity_resolution": (
        0.0,
        "The measured rate is a multiple of this; 0: continuous",
        _RATE,
    ),
    "sensor.dropout": (
        0.0,
        "Probability that a measurement fails; the previous one is then held",
        {"minimum": 0.0, "maximum": 1.0, "fixed": True},
    ),
    "sensor.position_limit": (
        inf,
        "The largest angle that is measured, either way",
        {"unit": "rad", **_LIMIT},
    ),
    "sensor.velocity_limit": (
        inf,
        "The largest rate that is measured, either way",
        {"unit": "rad/s", **_LIMIT},
    ),
    "sensor.delay": (
        0.0,
        "Delay of the measurements, rounded to whole periods",
        {"unit": "s", "minimum": 0.0, "maximum": 10.0, "fixed": True},
    ),
    "sensor.seed": (1, "Seed of the sensor noise", _SEED),
    "link.command.missing": (
        "hold",
        "A step that gets no new command: hold the last one's torque, or zero",
        {"choices": MISSING, "fixed": True},
    ),
    "link.seed": (1, "Seed of the links and of failing measurements", _SEED),
    "operator.force": (
        0.0,
        "Largest force of an operator on the hip, either way; nobody may push if this and the torque are 0",
        {"unit": "N", "minimum": 0.0, "maximum": 1e6, "fixed": True},
    ),
    "operator.torque": (
        0.0,
        "Largest torque of an operator on the trunk, either way",
        {**_TORQUE, "fixed": True},
    ),
    "operator.timeout": (
        0.25,
        "A push ends when nothing has come from the operator for this long",
        {"unit": "s", "above": 0.0, "maximum": 60.0, "fixed": True},
    ),
}


_CHANCE = {"minimum": 0.0, "maximum": 1.0, "fixed": True}
_DELAY = {"unit": "s", "minimum": 0.0, "maximum": 10.0, "fixed": True}
JITTERS = ("uniform", "exponential")
ORDERS = ("latest", "arrival")
# Of a link, by the last part of the name.
LINK: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "delay": (
        0.0,
        "Delay of every message; it is used from the first step at or after its arrival",
        _DELAY,
    ),
    "jitter": (0.0, "Random additional delay: the largest, or the mean if exponential", _DELAY),
    "jitter_kind": ("uniform", "Distribution of the jitter", {"choices": JITTERS, "fixed": True}),
    "loss": (0.0, "Probability that a message is lost, outside of bursts", _CHANCE),
    "burst.begin": (0.0, "Probability in each step that a burst of losses begins", _CHANCE),
    "burst.end": (1.0, "Probability in each step of a burst that it ends", _CHANCE),
    "burst.loss": (1.0, "Probability that a message is lost in a burst", _CHANCE),
    "duplicates": (0.0, "Probability that a message is sent twice", _CHANCE),
    "order": (
        "latest",
        "latest: a message older than the one in use is ignored; arrival: the last to arrive counts",
        {"choices": ORDERS, "fixed": True},
    ),
}


def link_parameter(link: str, name: str) -> Any:
    """Return the declaration of a link's parameter; ``way``: "state", to the controller, or "command"."""
    default, description, limits = LINK[name]
    to = "measured states" if link == "state" else "commands"
    return parameter(f"link.{link}.{name}", default, f"{description} (link of the {to})", **limits)


def hardware_parameter(name: str) -> Any:
    """Return the declaration of the parameter with this name."""
    default, description, limits = _WORDS[name]
    return parameter(name, default, description, **limits)
