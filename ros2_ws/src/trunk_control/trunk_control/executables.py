"""The executables that `ros2 run` starts: quick to load, and they end cleanly on a signal at any time.

There is one for each registered law, `pid`, `fuzzy_pid` and so on, and `fuzzy_gains`.
"""

from __future__ import annotations

from collections.abc import Callable

from trunk_msgs_util.node import early_signals

from .laws import CONTROLLERS

fuzzy_gains = early_signals.node("trunk_control.gains_node")


def __getattr__(name: str) -> Callable[[], None]:
    if name not in CONTROLLERS:
        raise AttributeError(f"no executable {name!r}; there are {', '.join(CONTROLLERS)}")
    return early_signals.node("trunk_control.controller_node", name)
