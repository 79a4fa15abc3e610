"""Real nodes in a virtual world, seed by seed: whatever happens to a run, the invariants hold.

    source scripts/env.sh && python -m tests.seeds.check [COUNT] [--seed N] [--trace] [--compiled]

COUNT seeds from N on, from each N where several are given; --trace prints what happens in one; --compiled
judges the recordings with compiled code, as long ones are.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import redirect_stderr
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import click

from trunk_experiments.runs import engine

from . import nodes
from .faults import Run
from .invariants import broken
from .story import NS, STORIES, Fault, Story, draw
from .world import HungError, World

_RUN_NS = 40 * NS  # virtual; how long a run may take, waits for participants among it
_END_NS = 40 * NS  # ... and how long a process may take to end


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
    log = nodes.log_of([one for some in run.processes.values() for one in some])
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
