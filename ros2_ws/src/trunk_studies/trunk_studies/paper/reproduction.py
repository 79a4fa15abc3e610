"""The whole reproduction: runs, claims, errata, dependence on the rate, effect of the misprints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from trunk_core.results import Known, Result
from trunk_evidence.run_metrics import Metrics
from trunk_runs.plan import make_plan

from ..batch.compiled_run import run_compiled
from .claims import (
    BASELINES,
    CLAIMS,
    OF_THE_PAPER,
    PROFILES,
    ClaimVerdict,
    ClaimWord,
    PaperRun,
    Runs,
    cases,
    judge,
    run_in_graph,
    run_offline,
)
from .errata import ERRATA, Erratum, plain

RATES = (500.0, 800.0, 1000.0, 2000.0, 4000.0, 8000.0)  # Hz
RATE_KEYS = ("overshoot_deg", "iae", "effort", "peak_torque", "theta_max_deg")
Say = Callable[[str], None]


@dataclass
class Reproduction:
    """Everything that the report shows."""

    runs: Runs = field(default_factory=dict)
    graph: Runs = field(default_factory=dict)  # of the paper's profile; empty: not requested
    errata: list[tuple[Erratum, bool, str]] = field(default_factory=list)
    rates: dict[str, dict[float, dict[str, float] | None]] = field(default_factory=dict)
    literal: dict[str, Metrics | None] = field(default_factory=dict)

    def verdicts(self) -> list[tuple[ClaimVerdict, ClaimVerdict | None, ClaimVerdict]]:
        """Return each claim's verdict offline, in the graph, and offline in the practical profile."""
        paper, practical = PROFILES
        return [
            (
                judge(claim, self.runs, paper),
                judge(claim, self.graph, paper) if self.graph else None,
                judge(claim, self.runs, practical),
            )
            for claim in CLAIMS
        ]

    @property
    def differing(self) -> list[PaperRun]:
        """The graph runs whose bits differ from the offline runs'."""
        return [run for run in self.graph.values() if run.graph_differs != ""]


def reproduce(folder: Path, graph: bool, say: Say) -> Reproduction:
    """Record all runs in the folder and return the results; ``say`` is called with each next step."""
    result = Reproduction()
    recordings = folder / "runs"
    recordings.mkdir(parents=True, exist_ok=True)
    todo = [*cases(tuple(OF_THE_PAPER)), *cases(tuple(BASELINES))]
    for number, case in enumerate(todo, 1):
        say(f"offline run {number} of {len(todo)}: {case.stem}")
        result.runs[case] = run_offline(case, recordings)
    if graph:
        in_graph = [case for case in cases(tuple(OF_THE_PAPER)) if case.profile == PROFILES[0]]
        for number, case in enumerate(in_graph, 1):
            say(f"graph run {number} of {len(in_graph)}, lock-step: {case.stem}")
            offline = recordings / f"{case.stem}.mcap"
            result.graph[case] = run_in_graph(case, folder / "graph", offline)
    say("dependence on the rate")
    result.rates = rate_dependence()
    say("what the misprinted equations would give")
    result.literal = literal_model()
    say("errata")
    result.errata = [(erratum, *_shown(erratum)) for erratum in ERRATA]
    return result


def _shown(erratum: Erratum) -> tuple[bool, str]:
    shown, text = erratum.show()
    return bool(shown), text


def rate_dependence() -> dict[str, Any]:
    """Return, by figure and rate, the printed PID's metrics; None where it diverged.

    With Kd h near the bound 2 m l^2 M / (M + m) a derivative on the error turns the reference's step
    and the pulses into torques of Kd step / h, which grow as the period shrinks.
    """
    outcomes: dict[str, Any] = {}
    for figure in ("fig6", "fig7", "fig8", "fig9"):
        outcomes[figure] = {}
        for rate in RATES:
            plan = make_plan(figure, "pid", ["pid_as_printed"], everywhere={"update_rate": rate})
            values = run_compiled(plan).metrics()
            outcomes[figure][rate] = values and {key: getattr(values, key) for key in RATE_KEYS}
    return outcomes


def literal_model() -> dict[str, Any]:
    """Return, by controller and by ``none``, the metrics of Fig. 6 with the misprinted equations."""
    outcomes: dict[str, Any] = {}
    settings: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
        name: (c.node, c.params, ()) for name, c in OF_THE_PAPER.items()
    }
    settings["none"] = ("pid", (), tuple(f"pid.gains.{gain}=0.0" for gain in "pid"))
    for name, (node, params, values) in settings.items():
        for equations in ("plant_as_printed", "derived"):
            files = [*params, equations] if equations != "derived" else list(params)
            run = run_compiled(make_plan("fig6", node, files, values)).metrics()
            outcomes[f"{name}, {equations}"] = run
    return outcomes


class ComparedValue(NamedTuple):
    """One comparison ``value relation bound``, true or not; null: infinite."""

    label: str
    value: Known
    relation: str
    bound: Known
    unit: str
    holds: bool


class JudgedClaim(NamedTuple):
    """What some runs say of a claim."""

    verdict: ClaimWord
    text: str
    checks: list[ComparedValue]


class ClaimResult(NamedTuple):
    """A claim of the paper, and what the runs say of it."""

    key: str
    figures: str
    quote: str
    paper: str
    tolerance: str
    offline: JudgedClaim
    graph: JudgedClaim | None
    practical: JudgedClaim


class ErratumResult(NamedTuple):
    """A misprint, and whether a computation shows it."""

    where: str
    printed: str
    correct: str
    shown: bool
    computation: str


@dataclass(frozen=True)
class CaseResult(Result):
    """A run of the paper."""

    profile: str
    figure: str
    contender: str
    metrics: Metrics | None
    undershoot_deg: Known
    failure: Annotated[str | None, "When the plant diverged; null: it did not"]


@dataclass(frozen=True)
class GraphResult(CaseResult):
    """The same run in the graph."""

    identical: Annotated[bool, "Its bits are those of the offline run"]
    difference: str | None


@dataclass(frozen=True)
class PaperNumbers(Result):
    """All numbers of a reproduction: the file ``paper.json``."""

    runs: list[CaseResult]
    graph: Annotated[list[GraphResult], "Empty without --graph"]
    claims: list[ClaimResult]
    errata: list[ErratumResult]
    rates: Annotated[
        Mapping[str, Mapping[str, Mapping[str, float | None] | None]],
        "Metrics by figure and rate in Hz; null: diverged",
    ]
    equations_as_printed_fig6: Mapping[str, Metrics | None]


@dataclass(frozen=True)
class PaperPlace(Result):
    """Where a reproduction is."""

    folder: Path
    report: Path


@dataclass(frozen=True)
class PaperResult(PaperNumbers, PaperPlace, document="paper-1"):
    """The document of ``trunk paper``; the file paper.json is the same without schema, folder and report."""


def paper_numbers(result: Reproduction) -> PaperNumbers:
    """Return all numbers."""

    def judged(v: ClaimVerdict) -> JudgedClaim:
        checks = [
            ComparedValue(c.label, c.value, c.relation, c.bound, c.unit, c.holds) for c in v.checks
        ]
        return JudgedClaim(v.word, v.text(), checks)

    def run(r: PaperRun) -> CaseResult:
        return CaseResult(*r.case, r.metrics, r.undershoot_deg, r.failure or None)

    claims = []
    for offline, graph, practical in result.verdicts():
        c = offline.claim
        of_graph = None if graph is None else judged(graph)
        verdicts = judged(offline), of_graph, judged(practical)
        claims.append(ClaimResult(c.key, c.figures, c.quote, c.paper, c.tolerance, *verdicts))
    return PaperNumbers(
        [run(r) for r in result.runs.values()],
        [
            GraphResult(**vars(run(r)), identical=r.graph_differs == "", difference=r.graph_differs)
            for r in result.graph.values()
        ],
        claims,
        [
            ErratumResult(e.where, plain(e.printed), plain(e.correct), shown, plain(text))
            for e, shown, text in result.errata
        ],
        {
            figure: {f"{rate:g}": values for rate, values in by_rate.items()}
            for figure, by_rate in result.rates.items()
        },
        result.literal,
    )
