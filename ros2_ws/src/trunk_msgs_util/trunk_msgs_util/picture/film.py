"""`Film`: the pictures that a recording gets, at most 30 for each second of simulated time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.sax.saxutils import quoteattr

from ..samples import JointSample
from ..topics import MARKERS, ROBOT_DESCRIPTION, TF
from ..units import NANOSECONDS
from . import messages
from .messages import HIP_LINK, TRUNK_LINK, WORLD
from .shapes import (
    BLUE,
    GREY,
    HIP_SIZE,
    MASS_SIZE,
    TRUNK_SIZE,
    Color,
    Geometry,
    Scene,
    is_drawn,
    shapes,
)

RATE = 30.0  # Hz
_EVERY_NS = round(NANOSECONDS / RATE)


class Film:
    """Draws true states with the newest of everything else, and yields topics (relative) and messages."""

    def __init__(self) -> None:
        self._plant: dict[str, object] = {}
        self._geometry = Geometry()
        self._described = ""
        self._due_ns = 0
        self._last_ns = -1

    def reconfigure(self, parameters: Mapping[str, object]) -> None:
        """Take the simulator's parameters, or some that have changed."""
        self._plant.update(parameters)
        self._geometry = Geometry.from_parameters(self._plant)

    def is_due(self, stamp_ns: int) -> bool:
        """Return True if the state with this stamp is to be drawn; it starts over if stamps go back."""
        if stamp_ns < self._last_ns:
            self._due_ns = 0
        self._last_ns = stamp_ns
        return stamp_ns >= self._due_ns

    def drawn(self, stamp_ns: int) -> None:
        """Note that the state with this stamp is drawn: the next is due a while later."""
        self._due_ns = (stamp_ns // _EVERY_NS + 1) * _EVERY_NS

    def picture(
        self,
        truth: JointSample,
        disturbance: JointSample | None,
        reference: float | None,
        log_ns: int,
    ) -> Iterator[tuple[str, bytes]]:
        """Yield the messages of a true state's picture; the URDF first, if it has changed.

        ``reference`` in rad, None if it is not known. ``log_ns``: when they are logged. They are stamped with
        it, because a viewer looks up a transform at its playback time.
        """
        self.drawn(truth.stamp_ns)
        text = urdf(self._geometry)
        if text != self._described:
            self._described = text
            yield ROBOT_DESCRIPTION, messages.description(text)
        scene = scene_of(self._geometry, truth, disturbance, reference)
        if scene is None:
            return
        yield MARKERS, messages.markers(shapes(self._geometry, scene), log_ns)
        if is_drawn(self._geometry, scene):
            yield TF, messages.transforms(self._geometry, scene.x, scene.theta, log_ns)


def scene_of(
    geometry: Geometry,
    truth: JointSample,
    disturbance: JointSample | None,
    reference: float | None,
) -> Scene | None:
    """Return the scene of a true state; None if it does not have our joints."""
    hip, trunk = geometry.joints
    x, theta = value(truth, "position", hip), value(truth, "position", trunk)
    if x is None or theta is None:
        return None
    pushed = (
        any(value(disturbance, field, joint) for field in ("effort", "position"))
        for joint in (hip, trunk)
    )
    return Scene(x, theta, value(truth, "effort", trunk) or 0.0, reference, *pushed)


def value(sample: JointSample | None, field: str, name: str) -> float | None:
    """Return a named value of ``position`` or ``effort``; None without it."""
    if sample is None or name not in sample.name:
        return None
    values: tuple[float, ...] = getattr(sample, field)
    index = sample.name.index(name)
    return values[index] if index < len(values) else None


def urdf(geometry: Geometry) -> str:
    """Return the robot: a hip that moves along x, and a trunk that turns about y.

    Lengths in m. A URDF cannot say that the hip's height follows its path: ``tf`` does.
    """
    hip, trunk = (quoteattr(joint) for joint in geometry.joints)
    length = geometry.length
    return f"""<?xml version="1.0"?>
<robot name="trunk">
{_material("grey", GREY)}
{_material("blue", BLUE)}
  <link name="{WORLD}"/>
  <link name="{HIP_LINK}">
    <visual><geometry><sphere radius="{HIP_SIZE / 2.0!r}"/></geometry><material name="grey"/></visual>
  </link>
  <link name="{TRUNK_LINK}">
    <visual>
      <origin xyz="0 0 {length / 2.0!r}"/>
      <geometry><cylinder radius="{TRUNK_SIZE / 2.0!r}" length="{length!r}"/></geometry>
      <material name="blue"/>
    </visual>
    <visual>
      <origin xyz="0 0 {length!r}"/>
      <geometry><sphere radius="{MASS_SIZE / 2.0!r}"/></geometry>
      <material name="blue"/>
    </visual>
  </link>
  <joint name={hip} type="prismatic">
    <parent link="{WORLD}"/>
    <child link="{HIP_LINK}"/>
    <axis xyz="1 0 0"/>
    <limit lower="-1000000.0" upper="1000000.0" effort="0.0" velocity="1000000.0"/>
  </joint>
  <joint name={trunk} type="continuous">
    <parent link="{HIP_LINK}"/>
    <child link="{TRUNK_LINK}"/>
    <axis xyz="0 1 0"/>
  </joint>
</robot>
"""


def _material(name: str, color: Color) -> str:
    rgba = " ".join(f"{part:g}" for part in color)
    return f'  <material name="{name}"><color rgba="{rgba}"/></material>'
