"""What a plant is: its state, its accelerations and their integration, and what a plug-in declares.

A package registers its plants as entry points of the group ``trunk.plants``, ``NAME = MODULE:PLANT``; ours
are in `trunk_sim.plants`. The integration is pure: scalar functions of floats and named tuples, which
CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, make_dataclass, replace
from functools import cache
from math import pi
from typing import Any, ClassVar, NamedTuple, TypeVar

from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    Value,
    check,
    declarations,
    parameter,
)
from trunk_core.parameters.shared import PLANT_NAME, ManagedConfig, PeriodicConfig, plant_in
from trunk_core.parameters.shared import TRUNK as TRUNK
from trunk_core.plugins import PLANT_GROUP, Registry
from trunk_msgs_util.picture.frames import Picture

from .disturbances import CHANNELS

Config = TypeVar("Config", bound=ManagedConfig)


class PlantState(NamedTuple):
    """Two coordinates and their rates: the first in m or rad, the second in rad."""

    x: float
    theta: float
    x_dot: float
    theta_dot: float


# ``accelerations(state, force on the first coordinate, force on the second, constants)``, pure: it travels
# through the loop as a law's functions do. A force on a coordinate that turns is a torque.
Accelerations = Callable[[PlantState, float, float, Any], tuple[float, float]]


def rk4_step(
    state: PlantState,
    first: float,
    second: float,
    h: float,
    constants: Any,
    accelerations: Accelerations,
) -> PlantState:
    """Return the state after one step of ``h`` seconds, the forces on both coordinates held over it.

    The classical Runge-Kutta method of order 4: local error O(h^5), global O(h^4).
    """
    x, theta, v, w = state
    half = 0.5 * h
    a1, b1 = accelerations(state, first, second, constants)
    v2, w2 = v + half * a1, w + half * b1
    a2, b2 = accelerations(
        PlantState(x + half * v, theta + half * w, v2, w2), first, second, constants
    )
    v3, w3 = v + half * a2, w + half * b2
    a3, b3 = accelerations(
        PlantState(x + half * v2, theta + half * w2, v3, w3), first, second, constants
    )
    v4, w4 = v + h * a3, w + h * b3
    a4, b4 = accelerations(PlantState(x + h * v3, theta + h * w3, v4, w4), first, second, constants)
    sixth = h / 6.0
    return PlantState(
        x + sixth * (v + 2.0 * (v2 + v3) + v4),
        theta + sixth * (w + 2.0 * (w2 + w3) + w4),
        v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        w + sixth * (b1 + 2.0 * (b2 + b3) + b4),
    )


def advance(
    state: PlantState,
    first: float,
    second: float,
    period: float,
    substeps: int,
    constants: Any,
    accelerations: Accelerations,
) -> PlantState:
    """Return the state after one control period, integrated in ``substeps`` equal RK4 steps."""
    h = period / substeps
    for _ in range(substeps):
        state = rk4_step(state, first, second, h, constants, accelerations)
    return state


class Coordinate(NamedTuple):
    """A coordinate: the usual name of its joint, and its unit, "m" or "rad"."""

    joint: str
    unit: str

    @property
    def effort_unit(self) -> str:
        """The unit of a force on it."""
        return "N" if self.unit == "m" else "N m"


def joints_parameter() -> Any:
    """Return the declaration of the joints' names, which the plant's nodes share."""
    names = ("hip", "trunk")
    return parameter(
        "joints", names, "Names of the hip's and the trunk's joint", length=2, fixed=True
    )


@dataclass(frozen=True)
class PlantConfig(PeriodicConfig):
    """The simulator's parameters that come before a plant's own, which a subclass adds.

    A subclass has ``constants``, a named tuple of floats, of tuples of floats or of None, for its functions.
    """

    substeps: int = parameter(
        "substeps", 1, "RK4 steps per period", minimum=1, maximum=10_000, fixed=True
    )
    duration: float = parameter(
        "duration",
        0.0,
        "Simulated time after which the run is finished and the node ends; 0: never",
        unit="s",
        minimum=0.0,
        maximum=1e6,
        fixed=True,
    )
    joints: tuple[str, ...] = joints_parameter()

    kind: ClassVar[Plant]

    def __post_init__(self) -> None:
        """Check values that must fit together. Raises ParameterError."""

    @property
    def constants(self) -> Any:
        """What the plant's functions take."""
        raise NotImplementedError(f"{type(self).__name__}.constants")

    @property
    def accelerations(self) -> Accelerations:
        """The equations of motion."""
        return self.kind.accelerations


def second_angle(state: PlantState, constants: Any) -> float:
    """Return the magnitude of the second coordinate, rad: the largest angle whose sine most plants take."""
    return abs(state.theta)


_PARAMETER = re.compile(r"[a-z]\w*(\.[a-z]\w*)+", re.ASCII)
_JOINT = re.compile(r"[A-Za-z]\w*", re.ASCII)
_LEANING = PlantState(0.0, pi / 6.0, 0.0, 0.0)
_AT_REST = PlantState(0.0, 0.0, 0.0, 0.0)


def _same(constants: Any) -> Any:
    return constants


@dataclass(frozen=True, eq=False)
class Plant:
    """A plant of two coordinates, of which the second is an angle that is measured and held at a reference.

    ``drive``: which coordinate the command pushes, where actuator and joint friction act, 0 or 1; a positive
    command raises the second coordinate. ``start``: where runs start by default. ``rest``: it stays there
    without a command. ``fall``: the second coordinate's largest magnitude, rad, by default. ``energy`` [J]
    changes by forces and friction alone. ``held``: the first coordinate keeps its rate. ``level(constants)``:
    those with which it is linearised. ``largest_angle(state, constants)``: of all whose sines are taken, rad.
    Raises TypeError for another kind of plant, such as one of three coordinates.
    """

    name: str  # of its entry point, and in ``plant.name``
    label: str  # in tables and titles
    config: type[PlantConfig]
    coordinates: tuple[Coordinate, Coordinate]
    accelerations: Accelerations
    picture: Picture
    drive: int = 1
    start: PlantState = _LEANING
    rest: PlantState = _AT_REST
    fall: float = pi / 2.0
    energy: Callable[[PlantState, Any], float] | None = None
    held: Accelerations | None = None
    level: Callable[[Any], Any] = _same
    largest_angle: Callable[[PlantState, Any], float] = second_angle

    def __post_init__(self) -> None:
        named = f"plant {self.name!r}"
        if not (isinstance(self.config, type) and issubclass(self.config, PlantConfig)):
            raise TypeError(f"{named}: config {self.config!r}: a subclass of PlantConfig is needed")
        shared = declarations(PlantConfig)
        for name, declared in declarations(self.config).items():
            if name not in shared and (name == PLANT_NAME or not _PARAMETER.fullmatch(name)):
                raise TypeError(
                    f"{named}: parameter {name!r}: a name such as plant.mass is needed, and not {PLANT_NAME}"
                )
            try:
                check(declared, declared.default)
            except ParameterError as error:
                raise TypeError(f"{named}: a default: {error}") from None
        if not isinstance(self.picture, Picture):
            raise TypeError(f"{named}: picture {self.picture!r}: a Picture is needed")
        for field_name in ("start", "rest"):
            if not isinstance(getattr(self, field_name), PlantState):
                raise TypeError(
                    f"{named}: {field_name} {getattr(self, field_name)!r}: a PlantState is needed"
                )
        if len(self.coordinates) != 2:
            raise TypeError(f"{named}: {len(self.coordinates)} coordinates: two are needed")
        first, second = self.coordinates
        if first.unit not in ("m", "rad") or second.unit != "rad":
            raise TypeError(
                f"{named}: coordinates in {first.unit!r} and {second.unit!r}: the first in m or rad, "
                "the second, which is held, in rad"
            )
        if first.joint == second.joint or not all(
            map(_JOINT.fullmatch, (first.joint, second.joint))
        ):
            raise TypeError(
                f"{named}: joints {first.joint!r} and {second.joint!r}: two names of letters, digits and "
                "underscores are needed"
            )
        if self.drive not in (0, 1):
            raise TypeError(f"{named}: drive {self.drive!r}: 0 or 1, the coordinate that is pushed")
        if not 0.0 < self.fall <= pi:
            raise TypeError(f"{named}: fall {self.fall!r}: an angle in rad, above 0 and at most pi")
        if not self.label:
            raise TypeError(f"{named}: label {self.label!r}: a text is needed, such as 'Cart-pole'")

    @property
    def driven(self) -> Coordinate:
        """The coordinate that the command pushes."""
        return self.coordinates[self.drive]

    @property
    def channels(self) -> tuple[str, ...]:
        """What a disturbance may act on, in the order of `Disturbance`."""
        first, second = (coordinate.joint for coordinate in self.coordinates)
        return f"{first}_effort", f"{second}_effort", f"{first}_position", f"{second}_position"

    @property
    def channel_units(self) -> dict[str, str]:
        """The units of `channels`, by name."""
        first, second = self.coordinates
        units = first.effort_unit, second.effort_unit, first.unit, second.unit
        return dict(zip(self.channels, units, strict=True))

    def words(self, text: str) -> str:
        """Return a text about hip and trunk in the words of this plant."""
        first, second = self.coordinates
        words = {"hip": first.joint, "trunk": second.joint}
        words |= {noun.capitalize(): joint.capitalize() for noun, joint in words.items()}
        return re.sub(rf"\b({'|'.join(words)})(?=s?\b)", lambda match: words[match[0]], text)

    @property
    def page_words(self) -> dict[str, object] | None:
        """What a page says in place of hip, trunk and torque; None for the trunk."""
        first, second = (coordinate.joint for coordinate in self.coordinates)
        slides = self.driven.unit == "m"
        return None if self.name == TRUNK else {"first": first, "second": second, "slides": slides}

    def of_drive(self, text: str) -> str:
        """Return a text about the drive's torque, or its unit, in the words of this plant."""
        if self.driven.unit == "m":
            text = re.sub(
                r"\b([Tt])orque(?=s?\b)", lambda m: "Force" if m[1] == "T" else "force", text
            )
            text = text.replace("N²·m²", "N²").replace("N m", "N").replace("N·m", "N")
        return self.words(text)

    def redeclared(self, declared: Declaration, law: bool = False) -> Declaration:
        """Return the trunk's declaration of a parameter as this plant has it: default, units and words.

        ``law``: of a control law, whose numbers are about the drive and the measured coordinates.
        """
        first, second = self.coordinates
        defaults: Mapping[str, Value] = {
            "joints": (first.joint, second.joint),
            "joint": second.joint,
            "hip_joint": first.joint,
            "initial.position": self.start[:2],
            "initial.velocity": self.start[2:],
            "fall.angle": self.fall,
        }
        units = {
            "initial.position": f"{first.unit}, rad",
            "initial.velocity": f"{first.unit}/s, rad/s",
            "operator.force": first.effort_unit,
        }
        unit = units.get(declared.name, declared.unit)
        words = self.words if first.unit == "m" else self._of_turning
        choices = [*self.channel_units.items()]
        if law:
            unit, words = self._of_law(unit), self.of_drive
            choices = [(choice, self._of_law(chosen)) for choice, chosen in declared.units]
        elif declared.unit_by and first.unit == "rad":  # of a disturbance's channel
            unit = "N m or rad"
        elif declared.name in _OF_DRIVE or declared.name.startswith("actuator."):
            unit, words = self.of_drive(unit), self.of_drive
            if self.driven.unit == "m":
                unit = unit.replace("rad", "m")
        names: dict[Value, str] = dict(zip(CHANNELS, self.channels, strict=True))
        default = defaults.get(declared.name, declared.default)
        return replace(
            declared,
            default=names.get(default, default),
            unit=unit,
            description=words(declared.description),
            choices=tuple(names.get(choice, choice) for choice in declared.choices),
            units=declared.units and tuple(choices),
        )

    def _of_turning(self, text: str) -> str:
        """Return a text about hip and trunk in the words of this plant, whose first coordinate turns."""
        text = text.replace("a force, a torque", "a torque").replace("Initial x", "Initial angle")
        return self.words(re.sub(r"\bforce\b", "torque", text))

    def _of_law(self, unit: str) -> str:
        """Return the unit of a law's parameter; a gain per metre is per unit of the first coordinate."""
        first = self.coordinates[0].unit
        return re.sub(r"^(N\b.*/\(?)m\b", rf"\1{first}", self.of_drive(unit))


_OF_DRIVE = ("max_effort", "command_timeout", "link.command.missing")

PLANTS: Registry[Plant] = Registry(PLANT_GROUP, "plant", lambda: Plant, (TRUNK, "cart_pole"))


def config_for(trunks: type[Config], base: type[Any], values: Mapping[str, object]) -> type[Config]:
    """Return the class of a node's parameters with the plant that ``plant.name`` among values names.

    ``trunks``: with the trunk. ``base``: the same, or, of the simulator, without any plant's own parameters.
    Raises ParameterError for a plant that is not installed, or cannot be used.
    """
    if values.get(PLANT_NAME, TRUNK) == TRUNK:
        return trunks
    kind: Any = base
    made: type[Config] = _made(kind, plant_in(PLANTS, values))
    return made


@cache
def _made(base: Any, plant: Plant) -> Any:
    """Return the class of a node's parameters with a plant other than the trunk; all but laws name it."""
    name = parameter(PLANT_NAME, plant.name, "The plant", choices=(plant.name,), fixed=True)
    law = not (issubclass(base, PlantConfig) or isinstance(getattr(base, "kind", None), Plant))
    members: list[Any] = [] if law else [("plant_name", str, name)]
    for member in fields(base):
        declared = member.metadata.get("declaration")  # a law's own fields may have none
        if declared and (ours := plant.redeclared(declared, law)) != declared:
            own = field(default=ours.default, metadata={"declaration": ours})
            members.append((member.name, member.type, own))
    bases = (base, plant.config) if issubclass(base, PlantConfig) else (base,)
    namespace = {"kind": plant, "of_trunk": base, "__reduce__": _reduced}
    namespace["__module__"] = base.__module__
    return make_dataclass(
        f"{base.__name__} of {plant.name}", members, bases=bases, namespace=namespace, frozen=True
    )


def _reduced(config: Any) -> tuple[Any, ...]:
    """Return how a configuration is pickled: by its plant's name, as its class was made in this process."""
    values = {member.name: getattr(config, member.name) for member in fields(config)}
    return _restored, (type(config).of_trunk, type(config).kind.name, values)


def _restored(base: Any, plant: str, values: Mapping[str, Any]) -> Any:
    return _made(base, PLANTS.named(plant))(**values)
