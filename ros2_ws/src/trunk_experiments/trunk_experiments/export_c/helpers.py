"""C that is the same in every program: what stands for operators and built-in functions of Python."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path


def template(name: str) -> str:
    """Return a template's text."""
    return (Path(str(files(__package__))) / "templates" / f"{name}.in").read_text("utf-8").strip()


HELPERS = {
    re.split(r"\W+", text.partition("(")[0])[-1]: text
    for text in template("helpers.h").split("\n\n")
}


def needed(words: set[str]) -> list[str]:
    """Return the helpers that a text with these words calls, each behind those that it calls."""
    wanted = set(words)
    for name, text in reversed(HELPERS.items()):
        if name in wanted:
            wanted |= set(re.findall(r"\w+", text))
    return [text for name, text in HELPERS.items() if name in wanted]
