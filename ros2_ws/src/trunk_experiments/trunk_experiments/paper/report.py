"""The report of the reproduction: one HTML file with embedded pictures, figures, JSON."""

from __future__ import annotations

import json
from base64 import b64encode
from importlib.resources import files
from math import isinf
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure

from trunk_msgs_util.whole_file import whole_file

from ..analysis.metrics import missing
from ..recorded.run import RecordedRun
from ..views.plot_style import save
from ..views.plots import paper_figure
from ..views.run_view import RunView
from .reproduction import RATE_KEYS, Reproduction, as_json
from .runs import CONTENDERS, FIGURES, OF_THE_PAPER, PROFILES, Case

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


def write_report(result: Reproduction, folder: Path) -> Path:
    """Write ``report.html``, ``paper.json`` and the figures as PNG and SVG; return the HTML's path."""
    text = json.dumps(as_json(result), indent=2, ensure_ascii=False, allow_nan=False)
    with whole_file(folder / "paper.json") as part:
        part.write_text(text + "\n", encoding="utf-8")
    pictures = {figure: _figure(figure, folder) for figure in FIGURES}
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["number"] = _number
    template = files(__package__).joinpath("report.html.j2").read_text(encoding="utf-8")
    page = environment.from_string(template).render(
        result=result,
        verdicts=result.verdicts(),
        pictures=pictures,
        columns=COLUMNS,
        contenders=CONTENDERS,
        figures=FIGURES,
        profiles=PROFILES,
        Case=Case,
        rate_keys=RATE_KEYS,
    )
    path = folder / "report.html"
    with whole_file(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def _figure(figure: str, folder: Path) -> str:
    """Draw a figure of the paper with our runs; return it as a data URL."""
    views, names = [], []
    for name, contender in OF_THE_PAPER.items():
        case = Case(PROFILES[0], figure, name)
        views.append(RunView.read(RecordedRun.open(folder / "runs" / f"{case.stem}.mcap")))
        names.append(contender.short)
    drawn: Figure = paper_figure(views, int(figure.removeprefix("fig")), names)
    for suffix in (".png", ".svg"):
        save(drawn, folder / f"{figure}{suffix}")
    return "data:image/png;base64," + b64encode((folder / f"{figure}.png").read_bytes()).decode()


def _number(value: float | None, key: str) -> str:
    return missing(key) if value is None or isinf(value) else f"{value:.5g}"
