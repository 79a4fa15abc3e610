"""The parameters of the ``markers`` node."""

from __future__ import annotations

from dataclasses import dataclass

from trunk_core.parameters.declarations import parameter
from trunk_msgs_util.picture.film import RATE, WORLD


@dataclass(frozen=True)
class MarkersConfig:
    """Parameters of the ``markers`` node."""

    rate: float = parameter(
        "rate", RATE, "Pictures per second, at most", unit="Hz", minimum=1.0, maximum=RATE
    )
    frame: str = parameter("frame", WORLD, "Frame in which the shapes are drawn", fixed=True)
