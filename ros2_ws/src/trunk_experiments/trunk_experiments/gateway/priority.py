"""A process that gives way to others, so that what it shows is not slowed by being shown."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

# A third of what others get where there is not enough for all: a page still lives on a busy machine.
_NICE = 5
# Linux shares the processors among sessions first, and only within one by the processes' own priorities.
_OF_THE_SESSION = Path("/proc/self/autogroup")


def give_way() -> None:
    """Lower the priority of this process, and of its session, which it must have for itself."""
    with suppress(OSError):
        os.nice(_NICE)
    with suppress(OSError):
        _OF_THE_SESSION.write_text(str(_NICE), "ascii")
