"""The files that the gateway serves: those of the page, read once, by the one path of each."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from ..parts.inline import part
from ..parts.page import STYLES, page, scripts

_OWN = ("wire.js", "health.js", "live.js")
_SCRIPTS = scripts(feed=["wire.js"], own=["health.js", "live.js"])
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
    own = files(__package__) / "page"
    html = page(
        "Trunk, live",
        "\n".join(f'<link rel="stylesheet" href="{_path(name)}">' for name in STYLES),
        "\n".join(f'<script src="{_path(name)}"></script>' for name in _SCRIPTS),
    )
    texts = {
        name: (own / name).read_text(encoding="utf-8") if name in _OWN else part(name)
        for name in (*STYLES, *_SCRIPTS)
    }
    return {
        "/": PageFile(_KINDS[".html"], html.encode()),
        **{
            _path(name): PageFile(_KINDS[Path(name).suffix], text.encode())
            for name, text in texts.items()
        },
    }


def _path(name: str) -> str:
    return f"/{Path(name).name}"


def report_file(path: Path) -> PageFile:
    """Return a report for the page to open. Raises OSError."""
    return PageFile(_KINDS[".html"], path.read_bytes())
