"""What a node on the first host hears of a run.

It is a separate process: Fast DDS reads the addresses of its host once in a process.
"""

import json
import signal
import sys
from pathlib import Path

from ..graph.processes import until
from .hosts import Host

_SCRIPT = Path(__file__).with_name("listening_node.py")


class Listener:
    """Collects the torque [N m] of each true state, and what the simulator reports."""

    def __init__(self, host: Host) -> None:
        self._child = host.children.start("listener", sys.executable, _SCRIPT)
        self._stream = (self._child.folder / "listener.out").open()
        self._rest = ""
        self._torques: list[float] = []
        self._diagnostics: list[dict[str, str]] = []

    def close(self) -> None:
        self._stream.close()
        self._child.stop(signal.SIGTERM)

    def _read(self) -> None:
        *lines, self._rest = (self._rest + self._stream.read()).split("\n")
        for line in lines:
            said = json.loads(line)
            if "torque" in said:
                self._torques.append(said["torque"])
            else:
                self._diagnostics.append(said["diagnostics"])

    @property
    def torques(self) -> list[float]:
        """All up to now."""
        self._read()
        return self._torques

    def until_states(self, number: int) -> None:
        """Wait until this many states have been heard."""
        until(lambda: len(self.torques) >= number, f"{number} states are heard")

    def fresh_diagnostics(self) -> dict[str, str]:
        """Return what the simulator says in its second message from now."""
        self._read()
        seen = len(self._diagnostics)

        def second() -> dict[str, str] | None:
            self._read()
            return next(iter(self._diagnostics[seen + 1 :]), None)

        found: dict[str, str] = until(second, "the simulator diagnoses")
        return found
