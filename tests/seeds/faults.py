"""A story as it happens in the virtual world."""

from __future__ import annotations

import errno
import io
import signal
from collections.abc import Set
from pathlib import Path
from typing import Any

from trunk_msgs_util.recording import writer as writing

from . import nodes
from .story import CONTROLLERS, NS, Fault, Story, requests
from .world import Process, World


class Run:
    """A story as it happens."""

    def __init__(self, story: Story, world: World, folder: Path) -> None:
        self.story, self.world, self.folder = story, world, folder
        self.plan = story.plan()
        self.path = folder / f"{story.seed}.mcap"
        self.processes: dict[str, list[Process]] = {}
        self.disk_full = False
        self.kept: bytes | None = None  # of the file, as a killed recorder left it
        self.over = False
        self.stderr = io.StringIO()
        _disk.run = self

    def begin(self) -> None:
        """Start all nodes, some of them late, and let the faults come."""
        late = {f.node: f.value for f in self.story.faults if f.kind == "late"}
        for name in self.plan.configs:
            wait = round(late.get(name, 0.0) * NS)
            self.processes.setdefault(name, [])
            self.world.at(wait, lambda name=name: self.start(name))
        self.world.network.first["/joint_states"] = lambda: self.let_come(running=True)
        self.let_come(running=False)

    def let_come(self, running: bool) -> None:
        """Let the faults come whose time counts from now."""
        for fault in self.story.faults:
            if fault.running == running:
                self.world.at(fault.at_ns, lambda fault=fault: self.strike(fault))

    def start(self, name: str) -> None:
        """Start a node's process, unless the run is being ended."""
        if self.over:
            return
        more: dict[str, Any] = {}
        if name == "recorder":
            more = {"output": str(self.path)}
        self.processes[name].append(nodes.start(self.world, self.plan, name, **more))

    def last(self, name: str) -> Process | None:
        """Return a node's last process."""
        some = self.processes.get(name)
        return some[-1] if some else None

    def strike(self, fault: Fault) -> None:
        """Let a fault happen."""
        process = self.last(fault.node)
        kind = fault.kind
        if self.over or kind == "late":
            return
        self.world.note("fault", fault.describe())
        if kind == "clock":
            nodes.rcl.step_clock(round(fault.value * NS))
        elif kind == "full":
            self.disk_full = True
        elif kind == "second":
            self.processes.setdefault("second", [])
            other = next(name for name in CONTROLLERS if name != self.story.controller)
            plan = Story(0, self.story.lockstep, other, 1.0, ()).plan()
            self.processes["second"].append(nodes.start(self.world, plan, other))
        elif process is None:
            return
        elif kind == "stall":
            process.stalled_ns = self.world.now_ns + round(fault.value * NS)
        elif kind in ("crash", "restart"):
            self.kill(process)
            if kind == "restart":
                self.world.at(self.world.delay(NS // 10, 2 * NS), lambda: self.start(fault.node))
        elif kind == "stop":
            self.world.signal(process, signal.SIGINT)
        else:
            nodes.call(self.world, *requests(fault))

    def kill(self, process: Process) -> None:
        """End a process as SIGKILL does: what it has not handed to the system is lost."""
        if process.name == "recorder" and process.alive and self.path.exists():
            self.kept = self.path.read_bytes()
        self.world.crash(process)

    def published(self, topic: str, counted: Set[str] | None = None) -> tuple[int, int]:
        """Return how many messages there were at least and at most.

        ``counted``: at least those of these processes; None: of all.

        What a killed process kept is lost; what is sent once the recorder has ended comes too late for it, as
        from a controller that slept until the run was over.
        """
        writers = [one for one in self.world.network.writers if one.topic == "/" + topic]
        ends = [one.ended_ns for one in self.processes["recorder"]]
        until_ns = self.world.now_ns if None in ends else max(filter(None, ends), default=0)
        return (
            sum(
                sent_ns <= until_ns
                for one in writers
                if not one.process.crashed and (counted is None or one.process.identity in counted)
                for sent_ns in one.sent_ns
            ),
            sum(len(one.sent_ns) for one in writers),
        )

    @property
    def complaints(self) -> str:
        """What the processes have written to stderr apart from their logs."""
        return self.stderr.getvalue()

    def alive(self) -> list[Process]:
        """Return the processes that run."""
        return [one for some in self.processes.values() for one in some if one.alive]


class _Disk:
    """Between the recorder and its file: says that the disk is full where it is to be."""

    run: Run | None = None

    def __init__(self, file: Any) -> None:
        self._file = file

    def write(self, data: Any) -> Any:
        run = _Disk.run
        if run is not None and run.disk_full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._file.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


_disk = _Disk
_open_own = writing.open_own
writing.open_own = lambda *given, **more: _Disk(_open_own(*given, **more))  # type: ignore[assignment]
