"""The page of a run that can be changed: live, of a recording, or in a lab; and what pages are made of."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

# In the order in which a page loads them. The feed gives `wire`, which page.js opens.
_FIRST = (
    "numbers.js",
    "keys.js",
    "stage.js",
    "vendor/uPlot.iife.min.js",
    "shell.js",
    "store.js",
    "alarm.js",
)
_PICTURES = ("scene.js", "charts.js")
_PANELS = ("grip.js", "edits.js", "rules.js", "knobs.js")
_STYLES = ("style.css", "vendor/uPlot.min.css", "page.css")
STYLES = (*_STYLES, "screen.css")
REPORT_STYLES = (*_STYLES, "report.css")
# A report's feed comes before the charts: it says how fine they are drawn.
REPORT_SCRIPTS = ("report_feed.js", *_FIRST, *_PICTURES, "report.js", "page.js")


def scripts(feed: list[str], own: list[str]) -> list[str]:
    """Return the names of a page's scripts; ``feed``, ``own``: those that the other pages do not have."""
    return [*_FIRST, *feed, *_PICTURES, *_PANELS, *own, "page.js"]


def page(title: str, styles: str, scripts: str, lab: bool = False, policy: str = "") -> str:
    """Return the page; ``styles``, ``scripts``: elements of our own, which are not escaped."""
    environment = Environment(
        loader=PackageLoader(__package__, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        title=title, styles=Markup(styles), scripts=Markup(scripts), lab=lab, policy=policy
    )
