"""The page of a run that can be changed: live, of a recording, or in a lab; and what it is made of."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

# In the order in which a page loads them. The feed gives `wire`; `own` comes before the page opens it.
_FIRST = (
    "numbers.js",
    "keys.js",
    "stage.js",
    "vendor/uPlot.iife.min.js",
    "shell.js",
    "store.js",
    "alarm.js",
)
_PARTS = ("scene.js", "grip.js", "charts.js", "edits.js", "rules.js", "knobs.js")
STYLES = ("style.css", "vendor/uPlot.min.css", "page.css")


def scripts(feed: list[str], own: list[str]) -> list[str]:
    """Return the names of a page's scripts; ``feed``, ``own``: those that the other pages do not have."""
    return [*_FIRST, *feed, *_PARTS, *own, "page.js"]


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
