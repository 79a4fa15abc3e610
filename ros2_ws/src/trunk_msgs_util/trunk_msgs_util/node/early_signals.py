"""SIGINT and SIGTERM to a program that is still loading: a clean exit, no traceback from an import.

An executable of ours is loaded for some tenths of a second before it can take a signal in its own way.
Until then signals are held back (by whoever starts it: `block`), and its first act is to say how they
end it (`end_by`). So none is lost, and none meets Python's own handler in the middle of an import.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import FrameType

from ..errors import TrunkError
from . import middleware

ENDING = (signal.SIGINT, signal.SIGTERM)


def block() -> None:
    """Hold both signals back, in this process and in all that it starts from now on."""
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)


def unblock() -> None:
    """Let both signals through, also those that came in the meantime."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


@contextmanager
def held() -> Iterator[None]:
    """Hold both signals back within the block: what it starts begins with them held."""
    block()
    try:
        yield
    finally:
        unblock()


def end_by(end: Callable[[int], None]) -> None:
    """Call ``end`` with the signal's number when one comes, or has been held back until now."""

    def handle(number: int, frame: FrameType | None) -> None:
        end(number)

    for number in ENDING:
        signal.signal(number, handle)
    unblock()


def node(module: str, *arguments: str) -> Callable[[], None]:
    """Return the executable of a node: a signal before ``module.main`` takes them ends it with code 0.

    That is the code of a node that was told to end later on, too: it has done what it was told.
    """

    def main() -> None:
        end_by(lambda number: os._exit(0))  # nothing was begun: there is nothing to clean up
        try:
            middleware.prepare()  # where there is no room for rclpy, it is not even imported
        except TrunkError as error:
            print(f"{Path(sys.argv[0]).name}: error: {error}", file=sys.stderr)
            sys.exit(error.exit_code)
        import_module(module).main(*arguments)

    return main
