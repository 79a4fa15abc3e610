"""SIGINT and SIGTERM to a program that is still loading: a clean exit, no traceback from an import.

One of our executables takes some tenths of a second to load before it can handle signals itself. Whatever
starts it blocks them until then (`block`); the executable itself first sets how they end it (`end_by`).
So no signal is lost, and none reaches Python's own handler in the middle of an import.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import FrameType

from trunk_core.errors import EXIT_FAILED, EXIT_USAGE, TrunkError, unusable_setting
from trunk_core.files import leave, prepare_streams

from . import middleware

ENDING = (signal.SIGINT, signal.SIGTERM)


def block() -> None:
    """Block both signals in this process and in all that it starts from now on."""
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)


def unblock() -> None:
    """Unblock both signals; pending ones are delivered."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


@contextmanager
def held() -> Iterator[None]:
    """Block both signals in the body of a ``with``: processes started there begin with them blocked."""
    block()
    try:
        yield
    finally:
        unblock()


def end_by(end: Callable[[int], None]) -> None:
    """Call ``end`` with the signal's number when one arrives or is pending."""

    def handle(number: int, frame: FrameType | None) -> None:
        end(number)

    for number in ENDING:
        signal.signal(number, handle)
    unblock()


class Interrupt:
    """Both signals, kept until ``name`` is polled: nothing is left half done, no callback cut short."""

    def __init__(self) -> None:
        self.name: str | None = None
        self._handlers = {number: signal.signal(number, self._note) for number in ENDING}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.name = signal.Signals(number).name

    def __enter__(self) -> Interrupt:
        return self

    def __exit__(self, *_: object) -> None:
        self.restore()

    def restore(self) -> None:
        """Put the former handlers back."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def ignore(self) -> None:
        """Ignore later signals: one that arrives while the interpreter exits would kill it."""
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)


def node(module: str, *arguments: str, undone: str = "") -> Callable[[], None]:
    """Return the executable of a node: a signal before ``module.main`` handles them ends it with code 0.

    A running node that is told to end has the same code. ``undone``: what a node prints, and then
    fails, if it is stopped before it has begun.
    """

    def end(number: int) -> None:  # nothing has started, so there is nothing to clean up
        os.write(2, undone.encode())
        os._exit(EXIT_FAILED if undone else 0)

    def main() -> None:
        prepare_streams()
        if any(option.startswith("error") for option in sys.warnoptions):  # rclpy itself warns
            warnings.simplefilter("default")
        end_by(end)
        try:
            middleware.prepare()  # where there is no room for rclpy, it is not even imported
        except TrunkError as error:
            print(f"{Path(sys.argv[0]).name}: error: {error}", file=sys.stderr)
            sys.exit(error.exit_code)
        try:
            import_module(module).main(*arguments)
        except SystemExit as stop:
            if isinstance(stop.code, int):
                leave(stop.code)
            raise
        except Exception as error:
            line = unusable_setting(error)
            if not line:
                raise
            print(f"{Path(sys.argv[0]).name}: error: {line}", file=sys.stderr)
            sys.exit(EXIT_USAGE)

    return main
