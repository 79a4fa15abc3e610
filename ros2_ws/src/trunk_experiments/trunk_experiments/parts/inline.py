"""Scripts and styles as text of a page that is one file: no network, no server, no second file."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files


def part(name: str) -> str:
    """Return the text of a part, such as ``stage.js``."""
    return (files(__package__) / name).read_text(encoding="utf-8")


def inline(script: str) -> str:
    """Return a script whose text cannot end its script block early."""
    return script.replace("</script", r"<\/script").replace("<!--", r"<\!--")


def script_sources(scripts: list[str]) -> str:
    """Return the sources of a content security policy that allow these scripts and no other."""
    digests = (hashlib.sha256(script.encode("utf-8")).digest() for script in scripts)
    return " ".join(f"'sha256-{base64.b64encode(d).decode('ascii')}'" for d in digests)
