"""The parent of a recording that is a branch, by its provenance."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import NamedTuple

# The keys of a branch's provenance.
OF, PARENT, AT, CHANGES, MADE_BY = (
    "branch_of",  # SHA-256 of the parent's file
    "branch_parent",  # its name
    "branch_at",  # s
    "branch_changes",
    "branch_made_by",  # version and commit
)


class BranchOf(NamedTuple):
    """The run up to ``at`` s is the parent's; what follows was simulated, with these changes."""

    parent: str
    sha256: str
    at: float
    changes: str

    def describe(self) -> str:
        """Return the parent and the changes in a line."""
        return (
            f"from t = {self.at:g} s on simulated with {self.changes}: "
            f"branch of {self.parent}, SHA-256 {self.sha256[:12]}…"
        )


def branch_of(provenance: Mapping[str, str]) -> BranchOf | None:
    """Return the parent of a run that is a branch; None if it is not one, or its time is not recorded."""
    try:
        at = float(provenance[AT])
        branch = BranchOf(provenance[PARENT], provenance[OF], at, provenance[CHANGES])
    except (KeyError, ValueError):
        return None
    return branch if isfinite(at) else None
