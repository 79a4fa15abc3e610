"""The sensors' memory: past states, for the delay."""

from __future__ import annotations

from collections import deque

from .plant import PlantState


class DelayLine:
    """The true state a whole number of steps ago; until there are that many, the oldest known one."""

    def __init__(self, steps: int) -> None:
        self._line: deque[PlantState] = deque(maxlen=steps + 1)

    def push(self, state: PlantState) -> PlantState:
        """Append the latest state and return the delayed one."""
        self._line.append(state)
        return self._line[0]

    def clear(self) -> None:
        """Forget the past."""
        self._line.clear()
