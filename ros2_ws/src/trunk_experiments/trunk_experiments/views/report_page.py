"""The report as one self-contained HTML file: no network, no server, no second file.

A recording's content enters the page in only two ways: as text, escaped by Jinja's autoescaping, and as
JSON in a script block that is not run, with every ``<`` escaped. The content security policy allows the
page's own script, by its digest, and no connections.
"""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from trunk_msgs_util.files import atomic_write

from ..parts.inline import inline, part, script_sources
from ..parts.page import REPORT_SCRIPTS, REPORT_STYLES
from .report import Report, metric_text, quantity_label


def render(report: Report) -> str:
    """Return the page."""
    script = inline("\n".join(map(part, REPORT_SCRIPTS)))
    environment = Environment(
        loader=PackageLoader("trunk_experiments.parts", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"metric_text": metric_text, "quantity_label": quantity_label}
    return environment.get_template("report.html.j2").render(
        report=report,
        data=htmlsafe_json_dumps(report.data, allow_nan=False, separators=(",", ":")),
        policy=(
            f"default-src 'none'; script-src {script_sources([script])}; style-src 'unsafe-inline'; "
            "img-src data:; base-uri 'none'; form-action 'none'"
        ),
        # Our own files, nothing from the recording: the only text that is not escaped.
        style=Markup("".join(map(part, REPORT_STYLES))),
        script=Markup(script),
    )


def write(report: Report, path: Path) -> int:
    """Write the page; return its size in bytes. Raises OSError."""
    data = render(report).encode("utf-8")
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)
    return len(data)
