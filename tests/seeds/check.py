"""Real nodes in a virtual world, seed by seed: whatever happens to a run, the invariants hold.

    source scripts/env.sh && python -m tests.seeds.check [COUNT] [--seed N] [--trace] [--compiled]

COUNT seeds from N on, from each N where several are given; --trace prints what happens in one; --compiled
judges the recordings with compiled code, as long ones are.
"""

import errno
import hashlib
import io
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Set
from contextlib import redirect_stderr
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import click

from trunk_recording import writer as writing
from trunk_runs import engine

from . import nodes
from .invariants import broken
from .story import CONTROLLERS, NS, STORIES, Fault, Story, draw, requests
from .world import HungError, Process, World

_RUN_NS = 40 * NS  # virtual; how long a run may take, waits for participants among it
_END_NS = 40 * NS  # ... and how long a process may take to end


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
        _Disk.run = self

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
        writers = [writer for writer in self.world.network.writers if writer.topic == "/" + topic]
        ends = [process.ended_ns for process in self.processes["recorder"]]
        until_ns = self.world.now_ns if None in ends else max(filter(None, ends), default=0)
        return (
            sum(
                sent_ns <= until_ns
                for writer in writers
                if not writer.process.crashed
                and (counted is None or writer.process.identity in counted)
                for sent_ns in writer.sent_ns
            ),
            sum(len(writer.sent_ns) for writer in writers),
        )

    @property
    def complaints(self) -> str:
        """What the processes have written to stderr apart from their logs."""
        return self.stderr.getvalue()


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


_open_own = writing.open_own
writing.open_own = lambda *given, **more: _Disk(_open_own(*given, **more))  # type: ignore[assignment]


class Outcome(NamedTuple):
    """What came of a story."""

    found: tuple[str, ...]
    digest: str  # of the trace
    trace: tuple[str, ...]
    log: str


def play(story: Story, folder: Path) -> Outcome:
    """Let a story happen and return which invariants it broke."""
    world = nodes.new_world(story.seed)
    run = Run(story, world, folder)
    found: list[str] = []
    try:
        with redirect_stderr(run.stderr):
            run.begin()
            found += _until_over(run, world)
        world.bury()
        run.disk_full = False
        if run.kept is not None and len(run.processes["recorder"]) == 1:
            run.path.write_bytes(run.kept)
        found += broken(run)
    finally:
        world.bury()
        run.path.unlink(missing_ok=True)
    trace = tuple(world.trace)
    digest = hashlib.sha256("\n".join(trace).encode()).hexdigest()[:16]
    log = nodes.log_of([process for starts in run.processes.values() for process in starts])
    return Outcome(tuple(found), digest, trace, log)


def _until_over(run: Run, world: World) -> Iterator[str]:
    """Run until the simulator ends, then stop the others as ``trunk run`` does: the recorder last."""

    def simulated() -> bool:
        some = run.processes["simulator"]
        return bool(some) and not some[-1].alive

    try:
        world.run(simulated, _RUN_NS)
    except HungError:
        world.note("nobody goes on")
    run.over = True
    for names in (
        ("simulator",),
        tuple(set(run.processes) - {"simulator", "recorder"}),
        ("recorder",),
    ):
        some = [one for name in sorted(names) for one in run.processes[name] if one.alive]
        for process in some:
            world.signal(process, signal.SIGINT)
        try:
            world.run(lambda some=some: not any(one.alive for one in some), world.now_ns + _END_NS)
        except HungError as error:
            yield f"{', '.join(one.name for one in some if one.alive)}: {error}"


def shrink(story: Story, folder: Path) -> Story:
    """Return the story with as few faults as break an invariant."""
    shorter = True
    while shorter:
        shorter = False
        for i in range(len(story.faults)):
            less = story._replace(faults=story.faults[:i] + story.faults[i + 1 :])
            if play(less, folder).found:
                story, shorter = less, True
                break
    return story


def faults_of(story: Story) -> list[str]:
    """Return the faults, a line each."""
    return [Fault.describe(fault) for fault in story.faults] or ["none"]


@click.command()
@click.argument("count", type=int, default=300)
@click.option(
    "--seed", "firsts", multiple=True, default=(0,), help="The first one; may be repeated."
)
@click.option(
    "--story", "names", multiple=True, type=click.Choice(list(STORIES)), help="In place of seeds."
)
@click.option("--trace", is_flag=True, help="Print what happens in the first seed, and stop.")
@click.option("--twice", is_flag=True, help="Play each seed twice: the trace is the same.")
@click.option("--raw", is_flag=True, help="Do not look for the shortest list of faults.")
@click.option("--compiled", is_flag=True, help="Judge the recordings as long ones are judged.")
@click.option("--most", default=20, show_default=True, help="Stop after so many failures.")
def main(
    count: int,
    firsts: tuple[int, ...],
    names: tuple[str, ...],
    trace: bool,
    twice: bool,
    raw: bool,
    compiled: bool,
    most: int,
) -> None:
    """Play COUNT seeds; the exit code is 1 if one breaks an invariant."""
    if compiled:
        engine.worth_compiling = lambda *_: True  # type: ignore[assignment]
    folder = Path(tempfile.mkdtemp(prefix="seeds_", dir="/dev/shm"))
    done = failed = 0
    begun = time.perf_counter()
    stories: Iterable[Story] = map(STORIES.__getitem__, names)
    if not names:
        stories = (draw(first + i) for first in firsts for i in range(count))
    try:
        for story in islice(stories, 1 if trace else None):
            done += 1
            outcome = play(story, folder)
            if trace:
                print("\n".join((str(story), *outcome.trace, outcome.log)))
            found = list(outcome.found)
            if twice and play(story, folder).digest != outcome.digest:
                found.append("another trace the second time")
            if found:
                failed += 1
                less = story if raw else shrink(story, folder)
                mode = "lock-step" if story.lockstep else "real time"
                print(f"seed {story.seed} ({mode}, {story.controller}, {story.duration:g} s):")
                print("".join(f"  {line}\n" for line in found), end="")
                print("".join(f"    {line}\n" for line in faults_of(less)), end="", flush=True)
                if failed >= most:
                    break
        took = time.perf_counter() - begun
    finally:
        shutil.rmtree(folder)
    print(f"{done} seeds, {failed} failed; {3600 * done / took:.0f} an hour in one process")
    raise SystemExit(min(failed, 1))


if __name__ == "__main__":
    if (
        os.environ.get("PYTHONHASHSEED") != "0"
    ):  # the order of sets of names is part of a seed's trace
        os.environ["PYTHONHASHSEED"] = "0"
        os.execv(sys.executable, [sys.executable, "-m", "tests.seeds.check", *sys.argv[1:]])
    main()
