"""The report as one self-contained HTML file: no network, no server, no second file.

A recording's content enters the page in only two ways: as text, escaped by Jinja's autoescaping, and as
JSON in a script block that is not run, with every ``<`` escaped. The content security policy allows the
page's own scripts, by their digests, and no connections.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from trunk_msgs_util.files import atomic_write

from .report import Report, number, quantity_label

_SCRIPTS = (
    "numbers.js",
    "data.js",
    "clock.js",
    "keys.js",
    "stage.js",
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
    own = "\n".join((assets / name).read_text(encoding="utf-8") for name in _SCRIPTS)
    scripts = [_inline(plotly), _inline(own)]
    environment = Environment(
        loader=PackageLoader(__package__, "report_assets"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"number": number, "quantity_label": quantity_label}
    return environment.get_template("page.html").render(
        report=report,
        data=htmlsafe_json_dumps(report.data, allow_nan=False, separators=(",", ":")),
        policy=_policy(scripts),
        # Our own files, nothing from the recording: the only text that is not escaped.
        style=Markup((assets / "style.css").read_text(encoding="utf-8")),
        scripts=[Markup(script) for script in scripts],
    )


def write(report: Report, path: Path) -> int:
    """Write the page; return its size in bytes. Raises OSError."""
    data = render(report).encode("utf-8")
    with atomic_write(path) as part:
        part.write_bytes(data)
    return len(data)


def _inline(script: str) -> str:
    """Return a script whose text cannot end its script block early."""
    return script.replace("</script", r"<\/script").replace("<!--", r"<\!--")


def _policy(scripts: list[str]) -> str:
    digests = (hashlib.sha256(script.encode("utf-8")).digest() for script in scripts)
    sources = " ".join(f"'sha256-{base64.b64encode(d).decode('ascii')}'" for d in digests)
    # Plotly sets inline styles, and exports pictures by data and blob URLs.
    return (
        f"default-src 'none'; script-src {sources}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
