"""`Film`: the pictures that a recording gets, at most 30 for each second of simulated time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..samples import JointSample
from ..topics import MARKERS, ROBOT_DESCRIPTION, TF
from ..units import NANOSECONDS
from . import messages
from .shapes import Geometry, Scene, is_drawn, shapes
from .urdf import urdf

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
