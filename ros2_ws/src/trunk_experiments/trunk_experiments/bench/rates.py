"""A comparison of two sides by how much each does in a second."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RateRow:
    """Medians over the rounds: of each side's rate (messages or steps per second), and of their ratio."""

    name: str
    ours_hz: float
    theirs_hz: float
    ratio: float  # in each round, ours to theirs
    goal: str
    met: bool
