"""The trunk as a URDF whose joints have the names of ``joint_states``."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from .messages import HIP_LINK, TRUNK_LINK, WORLD
from .shapes import BLUE, GREY, HIP_SIZE, MASS_SIZE, TRUNK_SIZE, Color, Geometry


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
