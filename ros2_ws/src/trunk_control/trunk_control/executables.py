"""The executables that `ros2 run` starts: quick to load, and they end cleanly on a signal at any time.

There is one for each law of this package, `pid`, `fuzzy_pid` and so on, and `fuzzy_gains`. A package with
laws of its own makes theirs with `of_law`.
"""

from __future__ import annotations

from collections.abc import Callable

from trunk_msgs_util.node import early_signals


def of_law(name: str) -> Callable[[], None]:
    """Return the executable of a registered law's node."""
    return early_signals.node("trunk_control.controller_node", name)


pid = of_law("pid")
fuzzy_pid = of_law("fuzzy_pid")
lqr = of_law("lqr")
computed_torque = of_law("computed_torque")
fuzzy_gains = early_signals.node("trunk_control.gains_node")
