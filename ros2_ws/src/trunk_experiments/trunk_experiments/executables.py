"""The executables that `ros2 run` and a shell start; they end cleanly on a signal at any time."""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from threading import Thread

from trunk_core.errors import EXIT_DEFECT
from trunk_core.files import discard_parts, leave, prepare_streams
from trunk_msgs_util.node import early_signals

_SAID: list[bool] = []  # not empty: the line has been written
_PATIENCE = 0.5  # s that a verb has to clean up
# These start or talk to other processes, and take the time to end them in order.
_WITH_OTHERS = {"run", "sweep", "paper", "params", "tune", "live", "study map", "study report"}

# These have loaded rclpy, and nothing is left to do after them.
_LEAVE_AT_ONCE = {"params", "run", "live"}

composed = early_signals.node("trunk_runs.composed_node")
markers = early_signals.node("trunk_views.markers_node")


class _Interrupted(BaseException):
    """Unwinds a verb, so that it leaves nothing half done; no ``except Exception`` stops it."""

    def __init__(self, number: int) -> None:
        self.number = number


def _works_with_others() -> bool:
    return bool({" ".join(sys.argv[1:2]), " ".join(sys.argv[1:3])} & _WITH_OTHERS)


def _unwind(number: int) -> None:
    early_signals.end_by(_end)  # a second signal: do not wait
    # Numba and LLVM crash on an asynchronous exception.
    compiles = not _works_with_others() and _is_in("numba.", "llvmlite.")
    # What imports may turn an exception into another, or go on as if there had been none.
    if compiles or _is_in("importlib."):
        _end(number)
    raise _Interrupted(number)


def _is_in(*modules: str) -> bool:
    """Return True inside a call of one of these modules, whose names begin so."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if str(frame.f_globals.get("__name__")).startswith(modules):
            return True
    return False


def _end(number: int) -> None:
    discard_parts()
    if not _SAID:
        cursor = b"\x1b[?25h" if os.isatty(2) else b""  # a progress bar may have hidden it
        os.write(2, cursor + b"interrupted\n")
    os._exit(128 + number)


def _end_soon() -> None:
    """End the process `_PATIENCE` after a signal even if the current call does not return to Python.

    Python's handlers wait for the call in progress, such as the drawing of a long curve.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing)

    def watch() -> None:
        number = os.read(reading, 1)[0]
        while number not in early_signals.ENDING:
            number = os.read(reading, 1)[0]
        time.sleep(_PATIENCE)
        _end(number)

    Thread(target=watch, daemon=True).start()


def _leave(stop: SystemExit) -> None:
    """End the process with the exit code of a finished verb."""
    if set(sys.argv[1:2]) & _LEAVE_AT_ONCE and isinstance(stop.code, int):
        leave(stop.code)


def trunk() -> None:
    """Run the ``trunk`` command; Ctrl-C or SIGTERM at any time gives one line and code 130 or 143.

    A defect gives its traceback and code 70: Python's own would be 1, the code of a verdict.
    """
    prepare_streams()
    early_signals.end_by(_end)
    if not _works_with_others():
        _end_soon()
    try:
        from .cli import main

        early_signals.end_by(_unwind)
        try:
            main()
        except SystemExit as stop:
            _leave(stop)
            raise
        finally:
            early_signals.end_by(_end)
    except _Interrupted as interrupted:
        early_signals.end_by(lambda number: os._exit(128 + number))
        _SAID.append(True)
        print("interrupted", file=sys.stderr)
        sys.exit(128 + interrupted.number)
    except Exception:
        traceback.print_exc()
        sys.exit(EXIT_DEFECT)
