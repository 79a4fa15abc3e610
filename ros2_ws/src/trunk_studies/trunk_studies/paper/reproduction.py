"""The whole reproduction: runs, claims, errata, dependence on the rate, effect of the misprints; its report.

The report is one HTML file with embedded pictures, figures beside it, and JSON.
"""

from __future__ import annotations

import json
import re
import unicodedata
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from markupsafe import Markup
from matplotlib.figure import Figure

from trunk_core.files import atomic_write
from trunk_core.results import Known, Result, number
from trunk_core.results import plain as json_values
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_metrics import Metrics
from trunk_runs.plan import make_plan
from trunk_views.parts.page import part, policy, rendered, write_page
from trunk_views.plots import paper_figure, save
from trunk_views.run_report import make_report, write
from trunk_views.run_view import RunView

from ..batch.compiled_run import run_compiled
from .claims import (
    BASELINES,
    CLAIMS,
    CONTENDERS,
    FIGURES,
    OF_THE_PAPER,
    PRINTED,
    PROFILES,
    TABLE_1,
    Case,
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
    for count, case in enumerate(todo, 1):
        say(f"offline run {count} of {len(todo)}: {case.stem}")
        result.runs[case] = run_offline(case, recordings)
    if graph:
        in_graph = [case for case in cases(tuple(OF_THE_PAPER)) if case.profile == PROFILES[0]]
        for count, case in enumerate(in_graph, 1):
            say(f"graph run {count} of {len(in_graph)}, lock-step: {case.stem}")
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


COLUMNS = {
    "overshoot_deg": "overshoot °",
    "undershoot_deg": "undershoot °",
    "settling_time_6deg_s": "settled (±6°) s",
    "steady_state_error_mean_deg": "error, last 2 s, mean °",
    "steady_state_error_rms_deg": "RMS °",
    "iae": "IAE rad·s",
    "ise": "ISE rad²·s",
    "itae": "ITAE rad·s²",
    "effort": "∫τ² N²m²s",
    "peak_torque": "peak N·m",
    "theta_min_deg": "smallest θ °",
    "theta_max_deg": "largest θ °",
}


def write_report(
    result: Reproduction, folder: Path, say: Say = lambda step: None, labs: bool = False
) -> Path:
    """Write ``report.html``, ``paper.json``, and each figure as PNG, SVG and HTML; return the page's path.

    ``say`` is called with each next step. ``labs``: the folder has a lab of each figure.
    """
    text = json.dumps(
        json_values(paper_numbers(result)), indent=2, ensure_ascii=False, allow_nan=False
    )
    with atomic_write(folder / "paper.json") as file:
        file.write_text(text + "\n", encoding="utf-8")
    pictures = {}
    for figure in FIGURES:
        say(f"drawing {figure}")
        pictures[figure] = _figure(figure, folder)
    page = rendered(
        __package__,
        "report.html.j2",
        policy=policy(),
        style=Markup(
            part("style.css") + files(__package__).joinpath("report.css").read_text("utf-8")
        ),
        result=result,
        verdicts=result.verdicts(),
        lead=lead(result),
        pictures=pictures,
        columns=COLUMNS,
        contenders=CONTENDERS,
        figures=FIGURES,
        labs=labs,
        profiles=PROFILES,
        Case=Case,
        rate_keys=RATE_KEYS,
        number=number,
        formulas=formulas,
    )
    path = folder / "report.html"
    write_page(page, path)
    return path


def lead(result: Reproduction) -> str:
    """Return in two sentences how many of the claims hold, and against which PID Fuzzy-PID does better."""
    verdicts = result.verdicts()
    counts = Counter(offline.short for offline, *_ in verdicts)
    gains = {PRINTED: "the printed gains", TABLE_1: "the gains of the paper’s own Table 1"}
    won = [f"with {gains[name]} in {won} of {of}" for name, (won, of) in _won(result).items()]
    return (
        f"With the paper’s own settings (profile paper), of its {len(verdicts)} claims "
        f"{counts['holds here']} hold here, {counts['partly holds']} hold partly and "
        f"{counts['fails here']} fail. Fuzzy-PID does better than the PID "
        f"{' comparisons, than the one '.join(won)} comparisons."
    )


def _won(result: Reproduction) -> dict[str, tuple[int, int]]:
    """Return, for each PID, in how many comparisons Fuzzy-PID did better, and how many there are."""
    counts: dict[str, tuple[int, int]] = {}
    for verdict, *_ in result.verdicts():
        for check in verdict.checks:
            if check.against:
                won, of = counts.get(check.contender, (0, 0))
                counts[check.contender] = (won + check.holds, of + 1)
    return counts


def _figure(figure: str, folder: Path) -> str:
    """Draw a figure of the paper with our runs, and animate these; return the picture as a data URL."""
    views, names = [], []
    for name, contender in OF_THE_PAPER.items():
        case = Case(PROFILES[0], figure, name)
        views.append(RunView.read(RecordedRun.open(folder / "runs" / f"{case.stem}.mcap")))
        names.append(contender.short)
    drawn: Figure = paper_figure(views, int(figure.removeprefix("fig")), names)
    for suffix in (".png", ".svg"):
        save(drawn, folder / f"{figure}{suffix}")
    write(make_report(views), folder / f"{figure}.html")
    return "data:image/png;base64," + b64encode((folder / f"{figure}.png").read_bytes()).decode()


_TOKEN = re.compile(
    r"""(?P<index>[A-Za-z]_(?:\{[^}]*\}|\w))|(?P<number>\d+(?:\.\d+)?)|(?P<name>sin|cos)
    |(?P<power>[⁻⁰¹²³⁴-⁹]+)|(?P<letter>[^\W\d_][\u0307\u0308]?)|(?P<sign>\S)""",
    re.VERBOSE,
)
_DOTS = {"\u0307": "˙", "\u0308": "¨"}


def formulas(text: str) -> Markup:
    """Return a text as HTML, its formulas, ``$m l² sin θ$``, as MathML."""
    parts = text.split("$")
    return Markup("").join(_mathml(part) if k % 2 else part for k, part in enumerate(parts))


def _mathml(formula: str) -> Markup:
    """Return a formula as elements, each after the first from a sign on: there a line may break."""
    rows: list[list[Markup]] = [[]]
    for token in _TOKEN.finditer(unicodedata.normalize("NFD", formula)):
        kind, text = token.lastgroup, token[0]
        if text in "+−=" and rows[-1]:
            rows.append([])
        row = rows[-1]
        if kind == "index":
            name, index = text[0], text[2:].strip("{}")
            row.append(Markup("<msub><mi>{}</mi><mtext>{}</mtext></msub>").format(name, index))
        elif kind == "power" and row:
            power = unicodedata.normalize("NFKC", text)
            row.append(Markup("<msup>{}<mn>{}</mn></msup>").format(row.pop(), power))
        elif kind == "letter" and text[1:]:
            letter = Markup("<mover><mi>{}</mi><mo>{}</mo></mover>")
            row.append(letter.format(text[0], _DOTS[text[1]]))
        elif kind == "name":
            row.append(Markup("<mi>{}</mi><mspace width='.15em'/>").format(text))
        else:
            tag = {"number": "mn", "letter": "mi"}.get(str(kind), "mo")
            attribute = ' stretchy="false"' if text in "()[]" else ""
            attribute = ' form="infix"' if text in "+−=" and len(rows) > 1 else attribute
            row.append(Markup(f"<{tag}{attribute}>{{}}</{tag}>").format(text))
    return Markup("").join(Markup("<math>{}</math>").format(Markup("").join(row)) for row in rows)
