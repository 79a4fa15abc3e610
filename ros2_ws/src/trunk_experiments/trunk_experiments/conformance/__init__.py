"""The conformance kit: whether a law meets the contract of all laws.

Each check is a function of a law that yields findings. `conformance` applies them by a registered name;
the same checks are test functions for a package's own tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from traceback import extract_tb

from trunk_control.laws import law_named

from .behaviour import finite_always, holds, pure, quick, types, within_limits
from .changes import keeps_time, reconfigures, reset, transfers
from .declared import bounded, in_default_file, named
from .finding import LawCheck, LawFinding
from .runs import compiles, exports, recomputes
from .sources import portable_source, pure_source

__all__ = ["CHECKS", "LawCheck", "LawFinding", "conformance", "findings_of"]

CHECKS = (
    LawCheck("declared", "its parameters have descriptions, bounds and units", bounded),
    LawCheck("defaults", "config/default.yaml, if any, has its parameters", in_default_file),
    LawCheck("names", "no term has the name of a field that every record has", named),
    LawCheck("types", "an update returns what is declared", types),
    LawCheck("source", "no state, clock, randomness or file in its source", pure_source),
    LawCheck("portable", "the same bits on every machine", portable_source),
    LawCheck("pure", "the same inputs give the same outputs", pure),
    LawCheck("finite", "no input makes it non-finite", finite_always),
    LawCheck("holds", "it holds memory and command if a sample is not usable", holds),
    LawCheck("limits", "its commands stay within the limits", within_limits),
    LawCheck("reset", "after a reset it behaves like new", reset),
    LawCheck("transfer", "it takes over without a jump", transfers),
    LawCheck("reconfigure", "it takes new parameters without adding a jump", reconfigures),
    LawCheck("time", "it depends on time, not on the number of samples", keeps_time),
    LawCheck("quick", "an update takes less than 0.2 ms", quick),
    LawCheck("compiled", "compiled code gives the same bits", compiles),
    LawCheck("exportable", "it can be written as C with the same bits", exports),
    LawCheck("replay", "a recording with it verifies", recomputes),
)


def findings_of(name: str, check: LawCheck) -> list[LawFinding]:
    """Return a check's findings and notes on a registered law.

    Raises KeyError for a name that is not registered, LawError for a law that cannot be loaded.
    """
    law = law_named(name)
    try:
        return list(check.run(law))
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        function = f"{law.update.__module__}.{law.update.__qualname__}"
        law_file = law.update.__code__.co_filename
        lines = [f.lineno for f in extract_tb(error.__traceback__) if f.filename == law_file]
        if lines:
            function += f", line {lines[-1]}"
        return [LawFinding(check.name, function, f"raises {reason}", "a law never raises")]


def conformance(name: str, checks: Sequence[LawCheck] = CHECKS) -> list[LawFinding]:
    """Return a registered law's breaches of the contract; empty if it conforms. Notes are left out."""
    return [finding for check in checks for finding in findings_of(name, check) if not finding.note]
