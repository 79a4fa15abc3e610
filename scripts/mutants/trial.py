"""One run of pytest in a child of this process, which has loaded what tests need: most of the start."""

from __future__ import annotations

import os
import resource
import select
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module

import pytest

# The project's own modules are not among them: each child loads its mutant.
for _name in ("hypothesis.strategies", "numpy", "sympy", "mpmath", "scipy.linalg", "numba", "mcap"):
    with suppress(ImportError):
        import_module(_name)

# The settings of pyproject.toml name plugins that are not loaded here.
ARGUMENTS = ("-x", "-q", "-p", "no:cacheprovider", "--import-mode=importlib", "-o", "addopts=")
_MEMORY = 8 * 2**30  # bytes; a mutant may well ask for all there is


def passes(tests: Sequence[str], timeout: float, quiet: bool = True) -> bool:
    """Return True where all tests pass within ``timeout`` s."""
    child = os.fork()
    if not child:
        _run(tests, quiet)
    watched = os.pidfd_open(child)
    try:
        ended, _, _ = select.select([watched], [], [], timeout)
        if not ended:
            os.killpg(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    finally:
        os.close(watched)
    return bool(ended) and status == 0


def _run(tests: Sequence[str], quiet: bool) -> None:
    """Be the child: never return."""
    code = 3
    try:
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        if quiet:
            with open(os.devnull, "w") as nowhere:  # noqa: PTH123
                os.dup2(nowhere.fileno(), 1)
                os.dup2(nowhere.fileno(), 2)
        code = int(pytest.main([*ARGUMENTS, "-W", "ignore", *tests]))
    finally:
        sys.stdout.flush()
        os._exit(code)
