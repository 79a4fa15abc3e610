"""The runs that judge the paper: figures x controllers x profiles, offline and in the graph."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import degrees, inf
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trunk_sim.simulation import DivergedError

from ..analysis.metrics import Metrics, metrics
from ..analysis.run_table import RunTable
from ..plans.plan import RunPlan, make_plan
from ..recorded.run import RecordedRun
from ..replay.diff import diff
from ..runs.graph import run_graph
from ..runs.node_processes import claimed_domain
from ..runs.offline_recording import record_offline
from ..runs.run_files import RunFiles

FIGURES = ("fig6", "fig7", "fig8", "fig9")
PROFILES = ("profile_paper", "profile_practical")


class PaperController(NamedTuple):
    """A controller with its gains: node, parameter file, label, short label for a legend."""

    node: str
    params: tuple[str, ...]
    title: str
    short: str = ""


# The controllers that the paper compares, and others worth comparing with them.
OF_THE_PAPER = {
    "pid_as_printed": PaperController(
        "pid", ("pid_as_printed",), "PID, gains as printed", "PID, printed"
    ),
    "pid_ziegler_nichols": PaperController(
        "pid", ("pid_ziegler_nichols",), "PID, Ziegler–Nichols", "PID, Z–N"
    ),
    "fuzzy_as_printed": PaperController(
        "fuzzy_pid", ("fuzzy_as_printed",), "Fuzzy-PID, printed tables", "Fuzzy, printed"
    ),
    "fuzzy_zhao_1993": PaperController(
        "fuzzy_pid", ("fuzzy_zhao_1993",), "Fuzzy-PID, 1993 tables", "Fuzzy, 1993"
    ),
}
BASELINES = {
    "pid_fixed_from_box": PaperController(
        "pid", ("pid_fixed_from_box",), "PID, fixed, from the gain box"
    ),
    "lqr": PaperController("lqr", (), "LQR with integral"),
    "computed_torque": PaperController("computed_torque", (), "Computed torque"),
}
CONTENDERS = {**OF_THE_PAPER, **BASELINES}


class Case(NamedTuple):
    """One run's name."""

    profile: str
    figure: str
    contender: str

    @property
    def stem(self) -> str:
        """Its recording's name."""
        return f"{self.figure}-{self.contender}-{self.profile.removeprefix('profile_')}"

    def plan(self, **everywhere: object) -> RunPlan:
        """Return its plan."""
        contender = CONTENDERS[self.contender]
        params = (*contender.params, self.profile)
        return make_plan(self.figure, contender.node, params, everywhere=everywhere)


@dataclass(frozen=True)
class PaperRun:
    """The result of a case. ``metrics`` is None if the plant diverged; then ``failure`` says when."""

    case: Case
    metrics: Metrics | None
    undershoot_deg: float  # the swing back across the reference after the overshoot
    failure: str = ""
    graph_differs: str | None = None  # a graph run: "" if it has the offline run's bits

    def value(self, key: str) -> float:
        """Return a metric; infinity if it does not exist (never settled, diverged)."""
        if key == "undershoot_deg":
            return self.undershoot_deg
        if key == "largest_deg":  # either way
            return max(abs(self.value("theta_min_deg")), abs(self.value("theta_max_deg")))
        value = None if self.metrics is None else getattr(self.metrics, key)
        return inf if value is None else float(value)


Runs = dict[Case, PaperRun]


def cases(contenders: tuple[str, ...] = tuple(CONTENDERS)) -> Iterator[Case]:
    """Yield every case of the table."""
    for profile in PROFILES:
        for figure in FIGURES:
            for contender in contenders:
                yield Case(profile, figure, contender)


def undershoot(table: RunTable) -> float:
    """Return by how many degrees the angle swings back past the last level of the reference.

    0 if it never crosses it. Counts from the last change of the reference.
    """
    changes = np.flatnonzero(np.diff(table.reference)) + 1
    start = int(changes[-1]) if len(changes) else 0
    past = table.theta[start:] - table.reference[-1]
    side = np.sign(past[0])
    crossed = np.flatnonzero(side * past < 0.0)
    return max(0.0, degrees(np.max(side * past[crossed[0] :]))) if len(crossed) else 0.0


def run_offline(case: Case, folder: Path) -> PaperRun:
    """Run a case without ROS, into a recording in the folder."""
    path = folder / f"{case.stem}.mcap"
    try:
        record_offline(case.plan(), path, overwrite=True)
    except DivergedError as error:
        return PaperRun(case, None, inf, str(error))
    return _judged(case, path)


def run_in_graph(
    case: Case, folder: Path, offline: Path, progress: Callable[[float], None] = lambda t: None
) -> PaperRun:
    """Run a case in the node graph, in lock-step and composed, and compare its bits with the offline run's.

    Raises RunError if the graph fails.
    """
    files = RunFiles(folder / case.stem)
    files.recording.unlink(missing_ok=True)
    with claimed_domain():
        run_graph(case.plan(**{"lockstep.enabled": True}), files, progress, composed=True)
    first = diff(RecordedRun.open(offline), RecordedRun.open(files.recording)).first
    return _judged(case, files.recording, "" if first is None else first.describe())


def _judged(case: Case, path: Path, graph_differs: str | None = None) -> PaperRun:
    table = RunTable.from_run(RecordedRun.open(path))
    return PaperRun(case, metrics(table), undershoot(table), graph_differs=graph_differs)
