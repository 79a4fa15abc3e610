"""The library: load, plan, simulate, sweep, measure, verify, explain and plot runs, in a script or notebook.

    import trunk_experiments.api as trunk

    run = trunk.simulate(trunk.plan("fig8", "fuzzy_pid"))
    print(trunk.metrics(run))
    trunk.plot(run, fig=8).save("fig8.png", overwrite=True)

The names in ``__all__`` are the contract; everything else may change. SI units and radians; every mistake
raises a `TrunkError` of one line. Importing this loads none of numba, pyarrow, matplotlib, pandas and ROS.
"""

from __future__ import annotations

from trunk_msgs_util.errors import RecordingError, TrunkError
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_sim.simulation import DivergedError

from ..analysis.parameter_text import ChangedParameter
from ..errors import LibraryError, PlanError, StudyError, SweepError
from ._plan import Plan, plan
from ._results import CheckedPart, Metrics, Picture, Verification, metrics, plot, report, verify
from ._run import Run, branch, load, simulate
from ._study import Contender, Study, Variation, draw, grid, read_study, study
from ._sweep import PairedDifference, Sweep, load_sweep, sweep
from ._tuning import (
    DrawsOutcome,
    Learned,
    Limit,
    Optimum,
    Relay,
    explain,
    learn,
    limit,
    optimise,
    relay,
    tune,
)
from ._values import UNITS, Parameter, controllers, parameter_files, parameters, scenarios, studies

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
    "DrawsOutcome",
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
