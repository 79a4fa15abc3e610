"""The conformance kit: whether a law keeps what every law promises.

Each check is a function of a law that yields findings. `conformance` applies them by a registered name;
the same checks are test functions for a package's own tests.
"""

from __future__ import annotations

from collections.abc import Sequence

from trunk_control.laws import law_named

from .behaviour import finite_always, holds, pure, quick, types, within_limits
from .changes import keeps_time, reset, retunes, takes_over
from .declared import bounded, named
from .finding import Check, Finding
from .runs import compiles, recomputes
from .sources import portable_source, pure_source

__all__ = ["CHECKS", "Check", "Finding", "conformance", "findings_of"]

CHECKS = (
    Check("declared", "its parameters have descriptions, bounds and units", bounded),
    Check("names", "its terms' names are its own", named),
    Check("types", "an update returns what is declared", types),
    Check("source", "no state, clock, chance or file in its source", pure_source),
    Check("portable", "the same bits on every machine", portable_source),
    Check("pure", "the same inputs give the same outputs", pure),
    Check("finite", "nothing that comes in makes it not finite", finite_always),
    Check("holds", "it holds where a sample is not usable", holds),
    Check("limits", "a command keeps the limits", within_limits),
    Check("reset", "after a reset it is as new", reset),
    Check("takeover", "it takes over without a jump", takes_over),
    Check("retune", "it takes new parameters without a jump of its own", retunes),
    Check("time", "it goes by time, not by samples", keeps_time),
    Check("quick", "an update takes less than 0.2 ms", quick),
    Check("compiled", "compiled code gives the same bits", compiles),
    Check("replay", "a recording with it verifies", recomputes),
)


def findings_of(name: str, check: Check) -> list[Finding]:
    """Return a check's findings and notes on a registered law.

    Raises KeyError for a name that is not registered, LawError for a law that cannot be loaded.
    """
    law = law_named(name)
    try:
        return list(check.run(law))
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        function = f"{law.update.__module__}.{law.update.__qualname__}"
        return [Finding(check.name, function, f"raises {reason}", "a law never raises")]


def conformance(name: str, checks: Sequence[Check] = CHECKS) -> list[Finding]:
    """Return what a registered law does not keep; empty if it conforms. Notes are left out."""
    return [one for check in checks for one in findings_of(name, check) if not one.note]
