"""SIGINT and SIGTERM for a verb that has to end other processes in order."""

from __future__ import annotations

import signal
from types import FrameType


class Interrupt:
    """SIGINT and SIGTERM, kept until ``name`` is polled: nothing is left half started."""

    def __init__(self) -> None:
        self.name: str | None = None
        self._handlers = {n: signal.signal(n, self._note) for n in (signal.SIGINT, signal.SIGTERM)}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.name = signal.Signals(number).name

    def __enter__(self) -> Interrupt:
        return self

    def __exit__(self, *_: object) -> None:
        self.restore()

    def restore(self) -> None:
        """Put the former handlers back."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
