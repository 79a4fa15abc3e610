"""Honest runs in real time, with real processes on a busy machine: none is accused, none falsely complete.

    source scripts/env.sh && python -m tests.honest.check [COUNT] [--seed N] [--workers N] [--busy N]

A run's processes are killed, stopped, restarted, retuned and disturbed by strangers, as its seed says. Its
recording must not diverge; if it is marked as complete, nothing that acted is missing, by other readers; and
a clean run is verified.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import click
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_evidence.verdict import DIVERGES, UNJUDGED, VERIFIED
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros
from trunk_recording.reader import Recording, RecordingError

from ..graph import play as graph
from ..graph.conftest import Domains
from ..graph.peer import Peer
from ..graph.processes import Child, Children
from ..seeds.story import Fault, Request, requests
from ..tampering.honest import judged
from .trial import CLEAN, Incident, Trial, draw
from .whole import Content, lacking

_TOKEN = "TRUNK_HONEST_TOKEN"  # by it we know our own, however indirect
_BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(100_000))\n"
_WORDS = {VERIFIED: "verified", UNJUDGED: "inconclusive", DIVERGES: "diverge"}
_COLUMNS = (*_WORDS.values(), "raises", "no file", "complete", "falsely complete", "failed")


_ASK_AGAIN_S = 0.05
_LATE = 10.0  # times its own duration a run may take on a busy machine, before it is stopped
_HUNG_S = 300.0  # until what was told to end counts as hung
# Of the factor on an ending node's wait for its recorder: a busy machine may hold the recorder up.
_PATIENCE = "20"


class HungError(Exception):
    """A process that did not begin, or did not end."""


class Play(graph.Play):
    """A trial with real processes over DDS: started, disturbed, and ended as somebody would by hand."""

    def __init__(self, trial: Trial, children: Children, peer: Peer, folder: Path) -> None:
        super().__init__(children, peer, folder)
        self.trial = trial
        self.changes: dict[str, list[Mapping[str, Any]]] = defaultdict(list)  # accepted, by node
        self._publishers: dict[str, Any] = {}
        touched = {(i.kind, i.node) for i in trial.incidents}
        without = bool(touched & {("kill", "recorder"), ("stop", "recorder")})
        os.environ["TRUNK_PATIENCE"] = "1" if without else _PATIENCE

    def play(self) -> None:
        """Play it, then end all that is left. Raises HungError."""
        for incident in self.trial.incidents:  # discovered before the run begins
            self._prepare(incident)
        plan = self.trial.plan()
        plan.write_parameters(self.folder / "params.yaml")
        for name in plan.configs:
            if name not in self.trial.absent:
                self.start(name)
        if "stranger instead" in self.trial.kinds:
            self._start_stranger()
        self.wait(self._begun, "the run begins")
        for incident in self.trial.incidents:
            self.after(incident.at_s, partial(self._do, incident))
        given_up_s = time.monotonic() + _LATE * self.trial.duration + 10.0
        self._peer.until(lambda: self._over() or time.monotonic() > given_up_s, "the run is over")
        last = [[n for n in self.processes if n not in ("simulator", "recorder")], ["recorder"]]
        self.end([["simulator"], *(last if self.trial.recorder_last else reversed(last))])

    def complaints(self) -> list[str]:
        """Return our nodes that ended as none should."""
        lines = []
        for name, children in self.processes.items():
            for child in children if name != "stranger" else ():
                code, text = child.process.returncode, child.stderr
                if "Traceback" in text or code not in (0, 1, -signal.SIGKILL):
                    last = text.strip().splitlines()[-1:]
                    lines.append(f"{name} ended with {code}: {' '.join(last)}")
        return lines

    def _begun(self) -> bool:
        started = any(e.message == "started" for e in self._peer.events)
        return started or not self.alive("simulator")

    def _over(self) -> bool:
        self.act()
        return not self._due and not self.alive("simulator")

    def wait(self, condition: Callable[[], object], purpose: str) -> None:
        deadline = time.monotonic() + _HUNG_S
        self._peer.until(lambda: condition() or time.monotonic() > deadline, purpose)
        if not condition():
            raise HungError(f"waited in vain: {purpose}")

    def _prepare(self, incident: Incident) -> None:
        for request in _requests(incident):
            self.prepare(request)
        if incident.held:
            self.prepare(_pause(True))
        create = self._peer.node.create_publisher
        if incident.kind == "push" and not self._publishers.get("push"):
            topic = f"/{topics.OPERATOR_REQUEST}"
            self._publishers["push"] = create(JointState, topic, qos.control())
        elif incident.kind == "refer" and not self._publishers.get("refer"):
            self._publishers["refer"] = create(JointState, f"/{incident.node}", 10)

    def _do(self, incident: Incident) -> None:
        kind, node, value = incident.kind, incident.node, incident.value
        start = partial(self._held, incident, partial(self.start, node))
        if asked := _requests(incident):
            call = self.ask(*asked)
            if call is not None and kind == "retune":
                call.add_done_callback(lambda done: self._accept(node, value, done.result()))
        elif kind == "push":
            message = JointState(name=["hip", "trunk"], effort=[0.0, value])
            message.header.frame_id = "somebody"
            self._publishers[kind].publish(message)
        elif kind == "refer":
            reference = JointSample(0, ("trunk",), position=(value,))
            self._publishers[kind].publish(sample_to_ros(reference))
        elif kind == "mistype":
            publisher = self._peer.node.create_publisher(Float64, f"/{node}", 10)
            publisher.publish(Float64(data=1.0))
        elif kind == "stranger":
            self._held(incident, self._start_stranger)
        elif kind in ("begin", "namesake"):
            start()
        else:
            if kind in ("kill", "restart") and self.alive(node):
                self.changes.pop(node, None)
            self.strike(kind, node, value, start)

    def _held(self, incident: Incident, start: Callable[[], Child]) -> None:
        """Start a process; the plant is paused meanwhile, if it is to be: a busy machine takes its time."""
        before = self._signs(incident.node)
        if incident.held:
            self.ask(_pause(True))
        child = start()
        if incident.held:
            self._resume(child, incident.node, before)

    def _resume(self, child: Child, node: str, before: int) -> None:
        """Let the plant go on once a process that was started acts, or has ended."""
        if child.alive and self._signs(node) == before:
            self.after(_ASK_AGAIN_S, partial(self._resume, child, node, before))
        else:
            self.ask(_pause(False))

    def _signs(self, node: str) -> int:
        """Return how often a node was activated; without a name: how many give commands."""
        if not node:
            return self._peer.node.count_publishers(f"/{topics.EFFORT_COMMAND}")
        return [event[:2] for event in self._peer.events].count((f"/{node}", Event.ACTIVATED))

    def _accept(self, node: str, values: Mapping[str, Any], response: Any) -> None:
        """Remember a change that was made while the run went on, by a node that was not killed since."""
        ended = any(e.message == "finished" for e in self._peer.events)
        if response is not None and response.result.successful and not ended:
            self.changes[node].append(values)

    def _start_stranger(self) -> Child:
        """Start a controller of somebody else's, which names no source."""
        fault = "names_its_frame" if self.trial.seed % 2 else "none"
        foreign = Path(graph.__file__).with_name("foreign_node.py")
        child = self._children.start("stranger", sys.executable, foreign, f"/={fault}")
        self.processes["stranger"].append(child)
        return child


def _pause(hold: bool) -> Request:
    return Request("/simulator/pause", SetBool, {"data": hold})


def _requests(incident: Incident) -> tuple[Request, ...]:
    """Return the call of a service that an incident consists of, if it is one."""
    if incident.kind == "pause":
        return (_pause(incident.value),)
    if incident.kind == "retune":
        parameters = [
            Parameter(name, value=list(v) if isinstance(v, tuple) else v).to_parameter_msg()
            for name, v in incident.value.items()
        ]
        service = f"/{incident.node}/set_parameters_atomically"
        return (Request(service, SetParametersAtomically, {"parameters": parameters}),)
    return requests(Fault(0, incident.kind, incident.node))


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
        run = judged(path.name, path)
    except Exception as error:  # a defect, whatever it is
        return {"raises"}, [f"verify raises {error!r}"]
    code = run.verdict.exit_code
    columns, wrong = {_WORDS[code]}, []
    if code == DIVERGES or run.contradictions:
        wrong.append(f"{run.verdict.word}: {run.accused}")
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
