"""What is done to a run: faults drawn from a seed, each of which can be left out."""

from __future__ import annotations

import errno
import io
import random
import signal
from pathlib import Path
from typing import Any, NamedTuple

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from std_srvs.srv import SetBool, Trigger

from trunk_experiments.plans.plan import RunPlan, make_plan
from trunk_msgs_util.recording import writer as writing

from . import nodes
from .world import NS, Process, World

CONTROLLERS = ("pid", "fuzzy_pid", "lqr")
_TRANSITIONS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4, "shutdown": 7}


class Fault(NamedTuple):
    """Something that happens to a node at a time."""

    at_ns: int
    kind: str
    node: str
    value: float = 0.0
    running: bool = False  # the time counts from the first measured state

    def describe(self) -> str:
        """Return it as a line."""
        since = " of the run" if self.running else ""
        value = f" {self.value:g}" if self.value else ""
        return f"{self.at_ns / NS:.6f} s{since}: {self.kind} {self.node}{value}"


class Story(NamedTuple):
    """A run, and what happens to it."""

    seed: int
    lockstep: bool
    controller: str
    duration: float
    faults: tuple[Fault, ...]

    def plan(self) -> RunPlan:
        """Return the plan of the nodes."""
        everywhere: dict[str, object] = {"duration": self.duration}
        if self.lockstep:
            everywhere["lockstep.enabled"] = True
        return make_plan("demo", self.controller, everywhere=everywhere)


# How often each kind is drawn; "node" is chosen among these.
_KINDS: tuple[tuple[str, int, tuple[str, ...]], ...] = (
    ("stall", 6, ("simulator", "controller", "disturbance", "recorder")),
    ("crash", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("restart", 3, ("controller", "disturbance", "recorder")),
    ("stop", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("late", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("clock", 2, ("",)),
    ("second", 1, ("controller",)),
    ("full", 2, ("recorder",)),
    ("reset", 3, ("simulator", "controller")),
    ("pause", 3, ("simulator",)),
    ("gains", 4, ("controller",)),
    ("deactivate", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("activate", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("cleanup", 1, ("controller",)),
)


def draw(seed: int) -> Story:
    """Return the story of a seed; some have no fault at all."""
    chance = random.Random(f"story {seed}")
    lockstep = chance.random() < 0.6
    controller = chance.choice(CONTROLLERS)
    duration = chance.choice((0.05, 0.1, 0.2))
    faults = []
    for _ in range(chance.choice((0, 1, 1, 2, 2, 3, 5))):
        kind, _, some = chance.choices(_KINDS, [weight for _, weight, _ in _KINDS])[0]
        node = chance.choice(some)
        node = controller if node == "controller" else node
        running = chance.random() < 0.6
        # Else before it begins, or some time.
        at = chance.choice((chance.uniform(0.0, 0.6), chance.uniform(0.3, 3.0)))
        at_ns = round((chance.uniform(0.0, 1.5 * duration) if running else at) * NS)
        value = {
            "stall": chance.choice((0.01, 0.1, 1.0, 6.0)) * chance.uniform(0.5, 1.5),
            "late": chance.uniform(0.1, 3.0),
            "clock": chance.uniform(-100.0, 100.0),
            "gains": chance.uniform(20.0, 80.0),
        }.get(kind, 0.0)
        faults.append(Fault(at_ns, kind, node, value, running))
    return Story(seed, lockstep, controller, duration, tuple(sorted(faults)))


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
            self.ask(fault)

    def kill(self, process: Process) -> None:
        """End a process as SIGKILL does: what it has not handed to the system is lost."""
        if process.name == "recorder" and process.alive and self.path.exists():
            self.kept = self.path.read_bytes()
        self.world.crash(process)

    def ask(self, fault: Fault) -> None:
        """Call a service of the node."""
        name, world = f"/{fault.node}", self.world
        if fault.kind == "reset":
            nodes.call(world, f"{name}/reset", Trigger.Request(), None)
        elif fault.kind == "pause":
            nodes.call(world, f"{name}/pause", SetBool.Request(data=True), None)
            world.at(
                world.delay(NS // 100, NS),
                lambda: nodes.call(world, f"{name}/pause", SetBool.Request(data=False), None),
            )
        elif fault.kind == "gains":
            key = "gains.p_max" if fault.node == "fuzzy_pid" else "gains.p"
            key = "u_clamp_max" if fault.node == "lqr" else key
            value = Parameter(name=key, value=ParameterValue(type=3, double_value=fault.value))
            request = SetParametersAtomically.Request(parameters=[value])
            nodes.call(world, f"{name}/set_parameters_atomically", request, None)
        else:
            request = ChangeState.Request()
            request.transition.id = _TRANSITIONS[fault.kind]
            nodes.call(world, f"{name}/change_state", request, None)

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
