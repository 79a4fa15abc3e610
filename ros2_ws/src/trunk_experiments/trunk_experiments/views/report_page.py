"""The report as one self-contained HTML file: no network, no server, no second file.

A recording's content enters the page in only two ways: as text, escaped by Jinja's autoescaping, and as
JSON in a script block that is not run, with every ``<`` escaped. The content security policy allows the
page's own scripts, by their digests, and no connections.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from trunk_msgs_util.files import atomic_write

from ..parts.inline import inline, part, script_sources
from .report import Report, metric_text, quantity_label

_PARTS = ("numbers.js", "keys.js", "stage.js")  # that other pages share
_SCRIPTS = (
    "data.js",
    "clock.js",
    "stages.js",
    "thin.js",
    "plots.js",
    "marks.js",
    "time_charts.js",
    "planes.js",
    "compare.js",
    "paper.js",
    "page.js",
)


def render(report: Report) -> str:
    """Return the page."""
    assets = files(__package__) / "report_assets"
    plotly = (assets / "vendor" / "plotly-cartesian.min.js").read_text(encoding="utf-8")
    own = [*map(part, _PARTS), *((assets / name).read_text(encoding="utf-8") for name in _SCRIPTS)]
    scripts = [inline(plotly), inline("\n".join(own))]
    environment = Environment(
        loader=PackageLoader(__package__, "report_assets"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"metric_text": metric_text, "quantity_label": quantity_label}
    return environment.get_template("page.html").render(
        report=report,
        data=htmlsafe_json_dumps(report.data, allow_nan=False, separators=(",", ":")),
        policy=_policy(scripts),
        # Our own files, nothing from the recording: the only text that is not escaped.
        style=Markup(part("style.css")),
        scripts=[Markup(script) for script in scripts],
    )


def write(report: Report, path: Path) -> int:
    """Write the page; return its size in bytes. Raises OSError."""
    data = render(report).encode("utf-8")
    with atomic_write(path) as part:
        part.write_bytes(data)
    return len(data)


def _policy(scripts: list[str]) -> str:
    # Plotly sets inline styles, and exports pictures by data and blob URLs.
    return (
        f"default-src 'none'; script-src {script_sources(scripts)}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
