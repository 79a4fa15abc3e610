"""Lower the priority of a process that shows a run, so that it does not slow the run."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

# A third of what others get on a busy machine: enough to keep a page alive.
_NICE = 5
# Linux shares the processors among sessions first, and only within one by the processes' own priorities.
_OF_THE_SESSION = Path("/proc/self/autogroup")


def give_way() -> None:
    """Lower the priority of this process, and of its session, which it must not share."""
    with suppress(OSError):
        os.nice(_NICE)
    with suppress(OSError):
        _OF_THE_SESSION.write_text(str(_NICE), "ascii")
