"""The files that the gateway serves: those of the page, read once, by the one path of each."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

_PACKAGE = __package__.partition(".")[0]
# Path of the address -> folder and name of the file: the page's own, and parts that other pages share.
_PAGE = {
    "/": "gateway/page/index.html",
    **{f"/{name}": f"gateway/page/{name}" for name in ("wire.js", "health.js")},
    **{
        f"/{name}": f"parts/{name}"
        for name in (
            "style.css",
            "page.css",
            "numbers.js",
            "keys.js",
            "stage.js",
            "store.js",
            "scene.js",
            "grip.js",
            "charts.js",
            "edits.js",
            "rules.js",
            "knobs.js",
            "page.js",
        )
    },
    "/uplot.js": "parts/vendor/uPlot.iife.min.js",
    "/uplot.css": "parts/vendor/uPlot.min.css",
}
_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}


class PageFile(NamedTuple):
    """A file's type and content."""

    kind: str
    data: bytes


def page_files() -> dict[str, PageFile]:
    """Return the page's files by path."""
    root = files(_PACKAGE)
    return {
        path: PageFile(_KINDS[Path(name).suffix], root.joinpath(name).read_bytes())
        for path, name in _PAGE.items()
    }


def report_file(path: Path) -> PageFile:
    """Return a report for the page to open. Raises OSError."""
    return PageFile(_KINDS[".html"], path.read_bytes())
