"""The library: load, plan, simulate, sweep, measure, verify, explain and plot runs, in a script or notebook.

    import trunk_experiments.api as trunk

    run = trunk.simulate(trunk.plan("fig8", "fuzzy_pid"))
    print(trunk.metrics(run))
    trunk.plot(run, fig=8).save("fig8.png", overwrite=True)

The names in ``__all__`` are the contract; everything else may change. SI units and radians; every mistake
raises a `TrunkError` of one line. Importing this loads none of numba, pyarrow, matplotlib, pandas and ROS.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from trunk_core.errors import (
    LibraryError,
    PlanError,
    RecordingError,
    StudyError,
    SweepError,
    TrunkError,
)
from trunk_core.parameters.declarations import ParameterError
from trunk_evidence.parameter_text import ChangedParameter
from trunk_evidence.run_metrics import Metrics
from trunk_evidence.verdict import CheckedPart, Verification
from trunk_runs.nodes import Parameter
from trunk_sim.simulation import DivergedError

from ._run import (
    Picture,
    Plan,
    Run,
    branch,
    load,
    metrics,
    plan,
    plot,
    report,
    simulate,
    verify,
)
from ._sweep import (
    Contender,
    Study,
    Sweep,
    Variation,
    draw,
    grid,
    load_sweep,
    read_study,
    study,
    sweep,
)
from ._tuning import explain, learn, limit, optimise, relay, tune
from ._values import UNITS, controllers, parameter_files, parameters, scenarios, studies

if TYPE_CHECKING:
    from trunk_studies.learning import Learned
    from trunk_studies.robustness import Limit
    from trunk_studies.statistics import DrawnRuns, Estimate, PairedDifference
    from trunk_studies.tuning.methods import Relay
    from trunk_studies.tuning.search import Optimum

_LATE = {  # results whose modules take long to load
    "DrawnRuns": "trunk_studies.statistics",
    "Estimate": "trunk_studies.statistics",
    "PairedDifference": "trunk_studies.statistics",
    "Learned": "trunk_studies.learning",
    "Limit": "trunk_studies.robustness",
    "Relay": "trunk_studies.tuning.methods",
    "Optimum": "trunk_studies.tuning.search",
}


def __getattr__(name: str) -> object:
    if name not in _LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LATE[name]), name)


__all__ = [  # noqa: RUF022 (in the order in which the site describes them)
    "plan",
    "Plan",
    "simulate",
    "load",
    "Run",
    "ChangedParameter",
    "metrics",
    "Metrics",
    "verify",
    "Verification",
    "CheckedPart",
    "plot",
    "Picture",
    "report",
    "explain",
    "branch",
    "tune",
    "relay",
    "Relay",
    "optimise",
    "Optimum",
    "limit",
    "Limit",
    "study",
    "read_study",
    "grid",
    "draw",
    "Contender",
    "Variation",
    "Study",
    "sweep",
    "load_sweep",
    "Sweep",
    "PairedDifference",
    "learn",
    "Learned",
    "DrawnRuns",
    "Estimate",
    "scenarios",
    "controllers",
    "parameter_files",
    "studies",
    "parameters",
    "Parameter",
    "UNITS",
    "TrunkError",
    "PlanError",
    "ParameterError",
    "StudyError",
    "RecordingError",
    "LibraryError",
    "DivergedError",
    "SweepError",
]
