"""What a user's own controller module imports: stable names, wherever the code behind them moves."""

from __future__ import annotations

from trunk_msgs_util.elementary import cos, exp, log, sin
from trunk_msgs_util.parameters.declarations import ParameterError, parameter

from .computed_torque import Hip
from .controller_config import ControllerConfig
from .law import Law, Lookup, Sample
from .pid import Gains, PidState, limited, pid_update, usable
from .pid import PidLaw as Limits
from .pid import Terms as PidTerms
from .pid_kind import constant_gains, law_of_pid_kind

__all__ = [
    "ControllerConfig",
    "Gains",
    "Hip",
    "Law",
    "Limits",
    "Lookup",
    "ParameterError",
    "PidState",
    "PidTerms",
    "Sample",
    "constant_gains",
    "cos",
    "exp",
    "law_of_pid_kind",
    "limited",
    "log",
    "parameter",
    "pid_update",
    "sin",
    "usable",
]
