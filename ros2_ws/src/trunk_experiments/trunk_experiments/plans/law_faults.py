"""Whose fault an exception is: a law of another package, told in one line with its place."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from traceback import extract_tb

from trunk_control.laws import law_named

from .nodes import CONTROLLERS, NODES

_OURS = "trunk_control"


def fault_of_a_law(error: BaseException) -> str:
    """Return what is wrong with which law, and where, if one of another package raised it; else empty."""
    for frame in reversed(extract_tb(error.__traceback__)):
        for name, folder in _places():
            if folder in Path(frame.filename).resolve().parents:
                what = " ".join(f"{type(error).__name__}: {error}".split())
                return (
                    f"controller {name!r}: {frame.filename}, line {frame.lineno}, in {frame.name}: {what}; "
                    f"trunk check controller {name} tries it alone"
                )
    return ""


def _places() -> Iterator[tuple[str, Path]]:
    """Yield laws of other packages and the folders of their sources."""
    for name in CONTROLLERS:
        if NODES[name].package != _OURS:
            yield name, Path(law_named(name).update.__code__.co_filename).resolve().parent
