"""What pages are made of: scripts, styles, templates; each page is one file, or served by paths of its own.

All that a template shows is escaped but what is `Markup`: text of our own files.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from trunk_core.files import atomic_write

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
_PICTURES = ("words.js", "scene.js", "charts.js")
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
    """Return the page of a run that can be changed, live or in a lab.

    ``styles``, ``scripts``: elements of our own, which are not escaped.
    """
    return rendered(
        __package__,
        "page.html.j2",
        title=title,
        styles=Markup(styles),
        scripts=Markup(scripts),
        lab=lab,
        policy=policy,
    )


def rendered(package: str, template: str, **values: object) -> str:
    """Return a template of a package with these values."""
    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.get_template(template).render(values)
    return text.encode("utf-8", "backslashreplace").decode()  # a file's name may be no text


def policy(script: str = "", more: str = "", images: str = "data:") -> str:
    """Return the content security policy of a page that is one file: this script runs, nothing is fetched.

    ``more``: sources of scripts.
    """
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    runs = f"script-src 'sha256-{digest}'{more}; " if script else ""
    return (
        f"default-src 'none'; {runs}style-src 'unsafe-inline'; img-src {images}; base-uri 'none'; "
        "form-action 'none'"
    )


def write_page(html: str, path: Path) -> int:
    """Write a page; return its size in bytes. Raises OSError."""
    data = html.encode("utf-8")
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)
    return len(data)


def part(name: str) -> str:
    """Return the text of a part, such as ``stage.js``."""
    return (files(__package__) / name).read_text(encoding="utf-8")


def inline(script: str) -> str:
    """Return a script whose text cannot end its script block early."""
    return script.replace("</script", r"<\/script").replace("<!--", r"<\!--")
