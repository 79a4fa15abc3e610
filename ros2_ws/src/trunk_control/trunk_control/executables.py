"""The executables that `ros2 run` starts: quick to load, and they end cleanly on a signal at any time.

There is one for each law of this package, `pid`, `fuzzy_pid` and so on, and `reference`. A package with its
own laws creates their executables with `of_law`.
"""

from __future__ import annotations

from collections.abc import Callable

from trunk_msgs_util.node import early_signals


def of_law(name: str) -> Callable[[], None]:
    """Return the executable of a registered law's node."""
    return early_signals.node("trunk_control.controller_node", name)


def __getattr__(name: str) -> Callable[[], None]:
    """Return the executable of the law of that name, so that only setup.py has to list the laws."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return of_law(name)


reference = early_signals.node("trunk_control.reference_node")
