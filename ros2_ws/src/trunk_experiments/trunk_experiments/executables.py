"""The executables that `ros2 run` and a shell start; they end cleanly on a signal at any time."""

from __future__ import annotations

import os
import sys

from trunk_msgs_util.node import early_signals

bare_pair = early_signals.node("trunk_experiments.bench.bare_pair_node")
composed = early_signals.node("trunk_experiments.runs.composed_node")
markers = early_signals.node("trunk_experiments.views.markers_node")


class _Interrupted(BaseException):
    """Unwinds a verb, so that it leaves nothing half done; no ``except Exception`` stops it."""

    def __init__(self, number: int) -> None:
        self.number = number


def _unwind(number: int) -> None:
    early_signals.end_by(_end)  # a second signal: do not wait
    raise _Interrupted(number)


def _end(number: int) -> None:
    os.write(2, b"interrupted\n")
    os._exit(128 + number)


def trunk() -> None:
    """Run the ``trunk`` command; Ctrl-C or SIGTERM at any time gives one line and code 130 or 143."""
    early_signals.end_by(_end)
    from .cli import main

    try:
        early_signals.end_by(_unwind)
        try:
            main()
        finally:
            early_signals.end_by(_end)
    except _Interrupted as interrupted:
        early_signals.end_by(lambda number: os._exit(128 + number))
        print("interrupted", file=sys.stderr)
        sys.exit(128 + interrupted.number)
