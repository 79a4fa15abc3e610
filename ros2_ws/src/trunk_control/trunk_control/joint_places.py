"""Where a controller's joints stand in a joint state: any robot's, whatever else it names. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Places(NamedTuple):
    """Indices into a joint state's arrays."""

    joint: int
    hip: int | None  # None: the law does not use the hip

    @property
    def last(self) -> int:
        """The greater index: arrays must be longer than this."""
        return max(self.joint, -1 if self.hip is None else self.hip)


class JointPlaces:
    """Finds the joints by name in each message; joints that it does not know are nothing to it.

    On a robot several publishers may share a topic, each with its own joints in its own order: the last
    names are remembered only where all that is needed was among them.
    """

    def __init__(self, joint: str, hip: str | None = None) -> None:
        self._joint = joint
        self._hip = hip
        self._names: Sequence[str] | None = None
        self._places = Places(0, None)

    def __call__(self, names: Sequence[str]) -> Places | None:
        """Return where the joints stand; None where one of them is not there."""
        if names != self._names:
            try:
                places = Places(
                    names.index(self._joint), None if self._hip is None else names.index(self._hip)
                )
            except ValueError:
                return None
            self._names, self._places = names, places
        return self._places
