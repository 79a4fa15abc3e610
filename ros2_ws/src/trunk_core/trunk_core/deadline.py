"""`Deadline`: how long others are waited for, in wall time; on a slow machine, by a factor longer."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import inf

from .errors import SettingError
from .text import plain_number


def patience(environment: Mapping[str, str] = os.environ) -> float:
    """Return the factor on all limits of waiting: TRUNK_PATIENCE, 1 by default. Raises SettingError."""
    text = environment.get("TRUNK_PATIENCE") or "1"
    with suppress(ValueError):
        if 0.0 < (factor := plain_number(text)) < inf:
            return factor
    raise SettingError(
        f"TRUNK_PATIENCE={text} is not allowed: a factor above 0 for slow machines, or unset it"
    )


class Deadline:
    """A limit in s, times the patience."""

    def __init__(self, limit_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.limit_s = limit_s * patience()
        self._clock = clock
        self.restart()

    def restart(self) -> None:
        """Start again from zero: there was a sign of life."""
        self._until_s = self._clock() + self.limit_s

    @property
    def passed(self) -> bool:
        """True once the limit is over."""
        return self._clock() > self._until_s
