"""The processes of a benchmark run: started with one parameter file, and stopped whatever happens."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ..plans.plan import RunPlan
from ..runs.processes import NodeProcess
from ..runs.stopping import stop


@dataclass(frozen=True)
class Way:
    """A set of processes: (name, package, arguments), in start order."""

    processes: tuple[tuple[str, str, tuple[str, ...]], ...]
    plan: RunPlan | None = None

    @contextmanager
    def started(self, folder: Path) -> Iterator[list[NodeProcess]]:
        """Make the folder, start all with the plan's parameters, and stop them at the end."""
        folder.mkdir()
        parameters = folder / "params.yaml"
        parameters.write_text("/**:\n  ros__parameters: {}\n")
        if self.plan is not None:
            recorder = replace(self.plan.recorder, output=str(folder / "run.mcap"))
            replace(self.plan, recorder=recorder).write_parameters(parameters)
        running: list[NodeProcess] = []
        try:
            for name, package, arguments in self.processes:
                log = folder / f"{len(running)}.log"
                running.append(NodeProcess.start(name, package, arguments, parameters, log))
            yield running
        finally:
            for process in reversed(running):
                stop([process], [])
