"""What a user's own controller module imports: stable names, wherever the code behind them moves."""

from __future__ import annotations

from trunk_core.elementary import atan2, cos, exp, log, sin, sqrt, tanh
from trunk_core.parameters.declarations import ParameterError, parameter

from .law import ControllerConfig, Hip, Law, Limits, Lookup, Sample, limited
from .pid import pid_update
from .pid_family import Gains, PidState, constant_gains, law_of_pid_family, usable
from .pid_family import Terms as PidTerms

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
    "atan2",
    "constant_gains",
    "cos",
    "exp",
    "law_of_pid_family",
    "limited",
    "log",
    "parameter",
    "pid_update",
    "sin",
    "sqrt",
    "tanh",
    "usable",
]
