"""A run whose nodes a test starts on the hosts of its choice, as `docs/hosts.md` says."""

from pathlib import Path

from trunk_recording.reader import Recording
from trunk_runs.plan import RunPlan

from ..graph.processes import Child
from .hosts import Host


class SpreadRun:
    """One parameter file for all hosts, and the nodes that were started with it."""

    def __init__(self, plan: RunPlan, folder: Path) -> None:
        self._running: dict[str, Child] = {}
        self._parameters, self._recording = folder / "params.yaml", folder / "run.mcap"
        plan.write_parameters(self._parameters)

    def start(self, host: Host, *names: str) -> None:
        for name in names:
            output = [f"output:={self._recording}"] if name == "recorder" else []
            self._running[name] = host.children.node(
                name, "--params-file", self._parameters, *output
            )

    def stderr(self, name: str) -> str:
        """Return what a node that runs has said so far."""
        return self._running[name].stderr

    def has_ended(self, name: str) -> bool:
        return self._running[name].process.poll() is not None

    def simulator_ends(self) -> tuple[int, str]:
        """Return the simulator's exit code and stderr, once it has ended by itself."""
        return self.ends("simulator")

    def ends(self, name: str) -> tuple[int, str]:
        """Return a node's exit code and stderr, once it has ended by itself."""
        node = self._running.pop(name)
        return node.wait(), node.stderr

    def stop(self, name: str, whole: bool = True) -> None:
        """Stop a node; it must end cleanly, the recorder of a run that is not whole with code 1."""
        node = self._running.pop(name)
        assert node.stop() == (name == "recorder" and not whole), f"{name}: {node.stderr}"
        assert "Traceback" not in node.stderr

    def stop_all(self, whole: bool = True) -> None:
        """Stop all nodes that still run, the recorder last."""
        for name in sorted(self._running, key="recorder".__eq__):
            self.stop(name, whole)

    def recording(self) -> Recording:
        return Recording.open(self._recording)
