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

from trunk_msgs_util.errors import RecordingError, TrunkError
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_sim.simulation import DivergedError

from ..analysis.metrics import Metrics
from ..analysis.parameter_text import ChangedParameter
from ..errors import LibraryError, PlanError, StudyError, SweepError
from ..plans.nodes import Parameter
from ..replay.verdict import CheckedPart, Verification
from ._plan import Plan, plan
from ._results import Picture, metrics, plot, report, verify
from ._run import Run, branch, load, simulate
from ._study import Contender, Study, Variation, draw, grid, read_study, study
from ._sweep import Sweep, load_sweep, sweep
from ._tuning import explain, learn, limit, optimise, relay, tune
from ._values import UNITS, controllers, parameter_files, parameters, scenarios, studies

if TYPE_CHECKING:
    from ..study.compare import DrawnRuns, Estimate, PairedDifference
    from ..study.learning import Learned
    from ..study.limit import Limit
    from ..tuning.methods import Relay
    from ..tuning.search import Optimum

_LATE = {  # results whose modules take long to load
    "DrawnRuns": "study.compare",
    "Estimate": "study.compare",
    "PairedDifference": "study.compare",
    "Learned": "study.learning",
    "Limit": "study.limit",
    "Relay": "tuning.methods",
    "Optimum": "tuning.search",
}


def __getattr__(name: str) -> object:
    if name not in _LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"..{_LATE[name]}", __name__), name)


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
