"""What the pages let their readers create in this folder, results and keys, never enters the repository."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from .finished import finished

ROOT = Path(__file__).parents[1]
# Their commands are typed in the reader's own folder.
ELSEWHERE = {"controllers.md", "rules.md", "tuning.md", "tutorial.md"}
PAGES = [
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    if page.name not in ELSEWHERE
]
_MADE = re.compile(r"(?:-o|--output|ed25519 -f)[ =]([\w./-]+)")


def made():
    """Return the files that the pages' commands write; placeholders are in capitals."""
    names = {
        name.rstrip(".")
        for page in PAGES
        for name in _MADE.findall(page.read_text(encoding="utf-8"))
        if not name.isupper() and not name.startswith("/")
    }
    keys = {"mine"} & names
    return sorted(
        names
        | {f"{key}.pub" for key in keys}
        | {f"{name}.sig" for name in names if name.endswith(".mcap")}
        | {"trunk_20260101T000000Z.mcap", "fig8.png", "fig8.html", "params.yaml"}  # by default
    )


@pytest.mark.skipif(
    not (ROOT / ".git").exists() or shutil.which("git") is None, reason="git, in a checkout"
)
def test_it_is_ignored():
    names = made()
    assert {"mine", "mine.pub", "fig8.mcap", "fig8.mcap.sig", "lqr.yaml"} <= set(names)
    done = finished(["git", "check-ignore", "--", *names], cwd=ROOT)
    assert set(names) - set(done.stdout.split()) == set()
