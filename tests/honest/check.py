"""Honest runs in real time, with real processes on a busy machine: none is accused, none falsely complete.

    source scripts/env.sh && python -m tests.honest.check [COUNT] [--seed N] [--workers N] [--busy N]

A run's processes are killed, stopped, restarted, retuned and disturbed by strangers, as its seed says. Its
recording must not diverge; if it is marked as complete, nothing that acted is missing, by other readers; and
a clean run is verified.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import click

from trunk_experiments.replay.verdict import DIVERGES, UNJUDGED, VERIFIED
from trunk_experiments.replay.verify import verify
from trunk_msgs_util.recording.reader import Recording, RecordingError

from ..graph.conftest import Domains
from ..graph.peer import Peer
from ..graph.processes import Children
from ..tampering.honest import Run
from .play import HungError, Play
from .trial import CLEAN, draw
from .whole import Content, lacking

_TOKEN = "TRUNK_HONEST_TOKEN"  # by it we know our own, however indirect
_BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(100_000))\n"
_WORDS = {VERIFIED: "verified", UNJUDGED: "inconclusive", DIVERGES: "diverge"}
_COLUMNS = (*_WORDS.values(), "raises", "no file", "complete", "falsely complete", "failed")


class Outcome(NamedTuple):
    """What came of a trial."""

    seed: int
    kinds: tuple[str, ...]
    columns: frozenset[str]  # in which it counts
    failures: tuple[str, ...]
    trial: str


def play(seed: int, folder: Path) -> Outcome:
    """Play a seed's trial in this process's ROS domain, and judge its recording."""
    trial = draw(seed)
    folder.mkdir(parents=True)
    children, peer = Children(folder), Peer("operator")
    failures: list[str] = []
    try:
        game = Play(trial, children, peer, folder)
        game.play()
        failures += game.complaints()
    except HungError as error:
        failures.append(str(error))
    finally:
        children.close(failed=bool(failures))
        peer.close()
    columns, accusations = _judged(folder / "run.mcap", game)
    failures += accusations
    columns |= {"failed"} if failures else set()
    return Outcome(seed, trial.kinds, frozenset(columns), tuple(failures), trial.describe())


def _judged(path: Path, game: Play) -> tuple[set[str], list[str]]:
    """Return the columns in which a recording counts, and what is wrong."""
    try:
        recording = Recording.open(path)
    except (OSError, RecordingError):
        clean = not game.trial.kinds
        return {"no file"}, ["a clean run without a recording"] if clean else []
    try:
        run = Run(path.name, recording.complete, verify(recording))
    except Exception as error:  # a defect, whatever it is
        return {"raises"}, [f"verify raises {error!r}"]
    code = run.verdict.exit_code
    columns, wrong = {_WORDS[code]}, []
    if code == DIVERGES:
        wrong.append(f"diverges: {run.accused}")
    if recording.complete:
        columns.add("complete")
        lines = list(lacking(Content(path), game.changes))
        columns |= {"falsely complete"} if lines else set()
        wrong += [f"falsely complete: {line}" for line in lines]
    if not game.trial.kinds and code == UNJUDGED:
        wrong.append(f"a clean run is inconclusive: {'; '.join(run.verdict.obstacles)}")
    return columns, wrong


# Workers.

_domains: Domains | None = None


def _begin_worker() -> None:
    """Leave a Ctrl-C to the process that started this one; children still take theirs."""
    signal.signal(signal.SIGINT, lambda *_: None)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["RCUTILS_COLORIZED_OUTPUT"] = "0"
    global _domains  # noqa: PLW0603
    _domains = Domains()


def _work(seed: int, folder: str) -> Outcome:
    assert _domains is not None
    os.environ["ROS_DOMAIN_ID"] = str(_domains.choose())
    return play(seed, Path(folder) / str(seed))


def _ours(token: str) -> list[int]:
    """Return the processes that began here, without multiprocessing's own, which ends with this one."""
    pids = []
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if (
                entry.name.isdigit()
                and f"{_TOKEN}={token}".encode() in ((entry / "environ").read_bytes().split(b"\0"))
                and b"resource_tracker" not in (entry / "cmdline").read_bytes()
            ):
                pids.append(int(entry.name))
    return pids


@contextmanager
def nothing_left() -> Iterator[None]:
    """End whatever was started, directly or not, when the block is left."""
    token = os.environ[_TOKEN] = uuid.uuid4().hex
    try:
        yield
    finally:
        while left := _ours(token):
            for pid in left:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            with suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            time.sleep(0.02)


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep processors busy; what keeps them so ends with this process, too."""
    processes = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def check(seeds: list[int], workers: int, folder: Path) -> int:
    """Play the seeds, print failures and, even if it is interrupted, totals; return how many failed."""
    rows: dict[str, Counter[str]] = {}
    total: Counter[str] = Counter()
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _begin_worker)
    try:
        for future in as_completed([pool.submit(_work, seed, str(folder)) for seed in seeds]):
            outcome = future.result()
            for kind in outcome.kinds or (CLEAN,):
                rows.setdefault(kind, Counter()).update({"runs", *outcome.columns})
            total.update({"runs", *outcome.columns})
            if outcome.failures:
                print(f"{outcome.trial}: {'; '.join(outcome.failures)}", flush=True)
            else:
                shutil.rmtree(folder / str(outcome.seed))
    finally:
        pool.shutdown(wait=sys.exc_info()[0] is None, cancel_futures=True)
        _report(rows, total)
    return total["failed"]


def _report(rows: dict[str, Counter[str]], total: Counter[str]) -> None:
    heads = ("runs", *_COLUMNS)
    print(f"{'kind':22}" + "".join(f"{head:>{len(head) + 3}}" for head in heads))
    for kind, row in sorted(rows.items()):
        print(f"{kind:22}" + "".join(f"{row[head]:{len(head) + 3}}" for head in heads))
    print(
        f"{total['runs']} honest runs: {total['verified']} verified, "
        f"{total['inconclusive']} inconclusive, {total['no file']} without a file, "
        f"{total['diverge']} diverge, {total['falsely complete']} falsely complete"
    )


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@click.command()
@click.argument("count", type=click.IntRange(1), default=300)
@click.option("--seed", default=0, show_default=True, help="The first one.")
@click.option("--workers", default=3, show_default=True, help="Runs at once.")
@click.option(
    "--busy", "spinning", default=2, show_default=True, help="Processes that only compute."
)
@click.option("--keep", is_flag=True, help="Keep the folders of runs that failed.")
def main(count: int, seed: int, workers: int, spinning: int, keep: bool) -> None:
    """Play COUNT honest runs; the exit code is 1 if one is accused, or falsely complete."""
    signal.signal(signal.SIGTERM, _interrupt)
    folder = Path(tempfile.mkdtemp(prefix="honest_"))
    failed = 0
    try:
        with nothing_left(), busy(spinning):
            failed = check(list(range(seed, seed + count)), workers, folder)
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    finally:
        if keep and failed:
            print(f"kept: {folder}")
        else:
            shutil.rmtree(folder, ignore_errors=True)
    raise SystemExit(min(failed, 1))


if __name__ == "__main__":
    main()
