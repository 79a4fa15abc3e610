"""Where a controller's joints are in any robot's joint state, whatever else it contains. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Places(NamedTuple):
    """Indices into a joint state's arrays."""

    joint: int
    hip: int | None  # None: the law does not use the hip

    @property
    def last(self) -> int:
        """The larger index: arrays must be longer than this."""
        return max(self.joint, -1 if self.hip is None else self.hip)


class JointPlaces:
    """Finds the joints by name in each message and ignores all others.

    On a robot several publishers may share a topic, each with its own joints in its own order: the last
    list of names is remembered only if it contained every joint needed.
    """

    def __init__(self, joint: str, hip: str | None = None) -> None:
        self._joint = joint
        self._hip = hip
        self._names: Sequence[str] | None = None
        self._places = Places(0, None)

    def __call__(self, names: Sequence[str]) -> Places | None:
        """Return the joints' indices, or None if one of them is missing."""
        if names != self._names:
            try:
                places = Places(
                    names.index(self._joint), None if self._hip is None else names.index(self._hip)
                )
            except ValueError:
                return None
            self._names, self._places = names, places
        return self._places
