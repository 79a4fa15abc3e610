"""The same domains, processes and listener as for the other tests of the graph; how long each end took."""

import os
from typing import Any

from ..graph.conftest import arguments, children, domain, domains, patient, peer
from . import matrix

__all__ = ["arguments", "children", "domain", "domains", "patient", "peer"]


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print how long the processes of each cell took to end, where every cell was tried."""
    taken = dict(
        value
        for report in terminalreporter.stats.get("passed", [])
        for name, value in getattr(report, "user_properties", [])
        if name == matrix.TOOK
    )
    if taken and os.environ.get("TRUNK_FAULTS") == "all":
        terminalreporter.section("from the fault to the end of all processes")
        for line in matrix.times(taken):
            terminalreporter.write_line(line)
