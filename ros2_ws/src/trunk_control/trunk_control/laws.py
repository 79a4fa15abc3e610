"""The registry of control laws: a law is its module's ``LAW``, and a line here.

Executables, parameters, topics, labels, plans, sweeps and the compiled loop follow from it.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .controller_config import ControllerConfig
    from .law import Law

# Name of the node and executable: module. setup.py reads this, so nothing above may import another package.
MODULES = {
    "pid": "trunk_control.pid_law",
    "fuzzy_pid": "trunk_control.fuzzy_pid_law",
    "lqr": "trunk_control.lqr_law",
    "computed_torque": "trunk_control.computed_torque_law",
}
CONTROLLERS = tuple(MODULES)


@cache
def law_named(name: str) -> Law:
    """Return a law by its node's name. Raises KeyError for a name that is not registered."""
    law: Law = import_module(MODULES[name]).LAW
    return law


def law_of(config: ControllerConfig) -> Law:
    """Return the law that a configuration belongs to. Raises TypeError if there is none."""
    for name in CONTROLLERS:
        law = law_named(name)
        if type(config) is law.config:
            return law
    raise TypeError(
        f"{type(config).__name__} belongs to no law; there are {', '.join(CONTROLLERS)}"
    )
