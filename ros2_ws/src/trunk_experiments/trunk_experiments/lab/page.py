"""A lab as one self-contained HTML file: no network, no server, no second file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2.utils import htmlsafe_json_dumps

from trunk_msgs_util.files import atomic_write

from ..parts.inline import inline, part, script_sources
from ..parts.page import STYLES, page, scripts

_ASSETS = files(__package__) / "assets"
# Before the parts: what stands in the place of a connection. Behind them: what a lab alone has.
_COMPUTING = ("random_bits.js", "python_numbers.js", "engine.js")
_CODING = ("bytes.js", "crc32.js", "blake2b.js", "cdr.js", "mcap.js")
_RECORDING = (*_CODING, "recording_writer.js", "recorder.js")
_FEED = (*_COMPUTING, *_RECORDING, "setup.js", "feed.js")
_OWN = ("events.js", "lab.js")


def render(lab: Mapping[str, Any]) -> str:
    """Return the page of a lab's data."""
    names = scripts(list(_FEED), list(_OWN))
    own = {*_FEED, *_OWN}
    script = inline("\n".join(_asset(name) if name in own else part(name) for name in names))
    data = _json(lab)
    digest = hashlib.sha256(f"{script}{data}".encode()).hexdigest()[:16]  # of all that computes
    data = _json({**lab, "digest": digest})
    policy = (
        f"default-src 'none'; script-src {script_sources([script])} 'wasm-unsafe-eval'; "
        "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return page(
        f"Lab: {lab['scenario']}",
        f"<style>{''.join(map(part, STYLES))}</style>",
        f'<script type="application/json" id="lab-data">{data}</script>\n<script>{script}</script>',
        lab=True,
        policy=policy,
    )


def write(lab: Mapping[str, Any], path: Path) -> int:
    """Write the page; return its size in bytes. Raises OSError."""
    data = render(lab).encode("utf-8")
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)
    return len(data)


def _json(data: Mapping[str, Any]) -> str:
    return htmlsafe_json_dumps(data, allow_nan=False, separators=(",", ":"))


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")
