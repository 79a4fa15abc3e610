"""The report of the reproduction: one HTML file with embedded pictures, figures, JSON."""

from __future__ import annotations

import json
import re
import unicodedata
from base64 import b64encode
from collections import Counter
from importlib.resources import files
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from trunk_core.files import atomic_write
from trunk_core.results import number, plain
from trunk_evidence.recorded_run import RecordedRun
from trunk_views.parts.page import part, policy, rendered, write_page
from trunk_views.plots import paper_figure, save
from trunk_views.run_report import make_report, write
from trunk_views.run_view import RunView

from .claims import CONTENDERS, FIGURES, OF_THE_PAPER, PRINTED, PROFILES, TABLE_1, Case
from .reproduction import RATE_KEYS, Reproduction, Say, paper_numbers

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
    text = json.dumps(plain(paper_numbers(result)), indent=2, ensure_ascii=False, allow_nan=False)
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
