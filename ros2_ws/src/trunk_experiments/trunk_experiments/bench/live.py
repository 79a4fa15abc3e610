"""What a gateway with pages costs the loop: one graph, measured in turn without them and with them."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from trunk_msgs_util import topics

from ..errors import BenchRunError
from ..gateway.process import LOOPBACK, GatewayProcess
from .realtime import LATENCY, MEASURES, begin, graph_of, measured

_MOST = 1.05  # of the latency without pages
_SHOWN = [name for name in MEASURES if not name.startswith("CPU")]
_MISSED = "missed steps"


@dataclass(frozen=True)
class LiveRow:
    """A measure of the loop without pages and with them: medians over the rounds, and of their ratio."""

    measure: str
    alone: float
    served: float
    unit: str
    ratio: float | None
    goal: str
    met: bool | None


def bench_live(
    rate: float = 1000.0, seconds: float = 10.0, rounds: int = 5, pages: int = 4
) -> list[LiveRow]:
    """Measure a recorded loop at ``rate`` Hz for ``seconds``, ``rounds`` times in turn.

    Raises BenchRunError if a process fails.
    """
    from ..live.observer_node import Observer

    alone, served = [], []
    with tempfile.TemporaryDirectory(prefix="trunk_bench_") as folder:
        loop = graph_of("fuzzy_pid", rate, recorded=True)
        with (
            loop.started(Path(folder) / "run") as running,
            Observer((topics.JOINT_STATES, topics.EFFORT_COMMAND)) as observer,
        ):
            begin(running, observer, seconds)
            for _ in range(rounds):
                alone.append(measured(running, observer, rate, seconds))
                with _pages(Path(folder) / "gateway.log", pages):
                    observer.watch(1.0, lambda: None)
                    served.append(measured(running, observer, rate, seconds))
                observer.watch(1.0, lambda: None)
    return [_row(name, alone, served) for name in _SHOWN]


@contextmanager
def _pages(log: Path, count: int) -> Iterator[None]:
    """Serve the graph to this many pages, which read everything."""
    gateway = GatewayProcess(log, LOOPBACK, 0, {"namespace": ""})
    try:
        with readers(gateway, log, count):
            yield
    finally:
        gateway.close()


@contextmanager
def readers(gateway: GatewayProcess, log: Path, count: int) -> Iterator[None]:
    """Let this many pages read everything. Raises BenchRunError if they are not served to the end."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "trunk_experiments.bench.page_readers"),
            *(gateway.address(gateway.tokens.watch), str(count)),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with process:
        assert process.stdout is not None
        if process.stdout.readline() != "ready\n":
            raise BenchRunError(f"benchmark: the gateway did not serve {count} pages: see {log}")
        yield
        if process.poll() is not None:
            raise BenchRunError(f"benchmark: the gateway stopped serving pages: see {log}")
        assert process.stdin is not None
        process.stdin.close()


def _row(name: str, alone: list[dict[str, float]], served: list[dict[str, float]]) -> LiveRow:
    before, after = ([values[name] for values in rounds] for rounds in (alone, served))
    ratio = median(b / a for a, b in zip(before, after, strict=True)) if all(before) else None
    goal, met = "", None
    if name == LATENCY and ratio is not None:
        goal, met = f"<= {_MOST:g}", ratio <= _MOST
    elif name == _MISSED:
        goal, met = "not more", median(after) <= median(before)
    return LiveRow(name, median(before), median(after), MEASURES[name], ratio, goal, met)
