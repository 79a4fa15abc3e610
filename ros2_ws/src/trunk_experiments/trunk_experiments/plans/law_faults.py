"""Whether a law of another package raised an exception: which one and where, in one line."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from traceback import extract_tb

from trunk_control.laws import law_named

from .nodes import CONTROLLERS, NODES

_OURS = "trunk_control"


def fault_of_a_law(error: BaseException) -> str:
    """Return which law failed, how and where, if one of another package raised it; else empty."""
    for frame in reversed(extract_tb(error.__traceback__)):
        file = Path(frame.filename).resolve()
        for name, place in _places():
            if place == file or place in file.parents:
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                return (
                    f"controller {name!r}: {frame.filename}, line {frame.lineno}, in {frame.name}: {reason}; "
                    f"trunk controller check {name} tests it alone"
                )
    return ""


def _places() -> Iterator[tuple[str, Path]]:
    """Yield laws of other packages, each with its package's folder or, where it is one, its module's file."""
    for name in CONTROLLERS:
        update = law_named(name).update
        top = str(getattr(update, "__module__", "")).partition(".")[0]
        file = getattr(sys.modules.get(top), "__file__", None)
        if NODES[name].package != _OURS and top != _OURS and file is not None:
            path = Path(file).resolve()
            yield name, path.parent if path.name == "__init__.py" else path
