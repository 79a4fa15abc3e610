"""The whole reproduction: runs, claims, errata, dependence on the rate, effect of the misprints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isinf
from pathlib import Path
from typing import Any

from ..batch.compiled_run import Batch
from ..plans.plan import make_plan
from .claims import CLAIMS, ClaimVerdict, judge
from .errata import ERRATA, Erratum, plain
from .runs import (
    BASELINES,
    OF_THE_PAPER,
    PROFILES,
    PaperRun,
    Runs,
    cases,
    run_in_graph,
    run_offline,
)

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
    literal: dict[str, dict[str, float] | None] = field(default_factory=dict)

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


def rate_dependence(rates: tuple[float, ...] = RATES) -> dict[str, Any]:
    """Return, by figure and rate, the printed PID's metrics; None where it diverged.

    With Kd h near the bound 2 m l^2 M / (M + m) a derivative on the error turns the reference's step
    and the pulses into torques of Kd step / h, which grow as the period shrinks.
    """
    batch = Batch()
    outcomes: dict[str, Any] = {}
    for figure in ("fig6", "fig7", "fig8", "fig9"):
        outcomes[figure] = {}
        for rate in rates:
            plan = make_plan(figure, "pid", ["pid_as_printed"], everywhere={"update_rate": rate})
            values = batch.run(plan).metrics()
            outcomes[figure][rate] = values and {key: getattr(values, key) for key in RATE_KEYS}
    return outcomes


def literal_model() -> dict[str, Any]:
    """Return, by controller and by ``none``, the metrics of Fig. 6 with the misprinted equations."""
    batch = Batch()
    outcomes: dict[str, Any] = {}
    settings: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
        name: (c.node, c.params, ()) for name, c in OF_THE_PAPER.items()
    }
    settings["none"] = ("pid", (), tuple(f"pid.gains.{gain}=0.0" for gain in "pid"))
    for name, (node, params, values) in settings.items():
        for equations in ("plant_as_printed", "derived"):
            files = [*params, equations] if equations != "derived" else list(params)
            run = batch.run(make_plan("fig6", node, files, values)).metrics()
            outcomes[f"{name}, {equations}"] = run and run.as_dict()
    return outcomes


def as_json(result: Reproduction) -> dict[str, Any]:
    """Return all numbers as JSON values; None for never and for infinity."""

    def number(value: float) -> float | None:
        return None if isinf(value) else value

    def verdict(v: ClaimVerdict | None) -> Any:
        return v and {
            "verdict": v.word,
            "text": v.text(),
            "checks": [
                {
                    "label": c.label,
                    "value": number(c.value),
                    "relation": c.relation,
                    "bound": number(c.bound),
                    "unit": c.unit,
                    "holds": c.holds,
                }
                for c in v.checks
            ],
        }

    def run(r: PaperRun) -> Any:
        return {
            **r.case._asdict(),
            "metrics": r.metrics and r.metrics.as_dict(),
            "undershoot_deg": number(r.undershoot_deg),
            **({"failure": r.failure} if r.failure else {}),
        }

    return {
        "runs": [run(r) for r in result.runs.values()],
        "graph": [
            {**run(r), "identical": r.graph_differs == "", "difference": r.graph_differs}
            for r in result.graph.values()
        ],
        "claims": [
            {
                "key": offline.claim.key,
                "figures": offline.claim.figures,
                "quote": offline.claim.quote,
                "paper": offline.claim.paper,
                "tolerance": offline.claim.tolerance,
                "offline": verdict(offline),
                "graph": verdict(graph),
                "practical": verdict(practical),
            }
            for offline, graph, practical in result.verdicts()
        ],
        "errata": [
            {
                "where": e.where,
                "printed": plain(e.printed),
                "correct": plain(e.correct),
                "shown": shown,
                "computation": plain(text),
            }
            for e, shown, text in result.errata
        ],
        "rates": {
            figure: {f"{rate:g}": values for rate, values in by_rate.items()}
            for figure, by_rate in result.rates.items()
        },
        "equations_as_printed_fig6": result.literal,
    }
