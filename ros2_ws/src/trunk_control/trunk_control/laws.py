"""The registry of control laws: entry points of the group ``trunk.controllers``, including ours.

A package declares ``NAME = MODULE:LAW``. Executables, parameters, topics, labels, plans, sweeps and the
compiled loop follow from the law.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trunk_core.plugins import LAW_GROUP, PluginError, Registry

if TYPE_CHECKING:
    from .law import ControllerConfig, Law


def _law() -> type[Law]:
    from .law import Law  # a node's executable needs only the names

    return Law


_FIRST = ("pid", "fuzzy_pid", "lqr", "computed_torque", "fuzzy", "state_feedback")
_LAWS: Registry[Law] = Registry(LAW_GROUP, "controller", _law, _FIRST)
REGISTERED = _LAWS.names
package_of = _LAWS.package_of  # the one whose executable runs its node
law_named = _LAWS.named


def law_of(config: ControllerConfig) -> Law:
    """Return the law that a configuration belongs to, with any plant. Raises TypeError if there is none."""
    kind = getattr(type(config), "of_trunk", type(config))
    for name in REGISTERED:
        try:
            law = law_named(name)
        except PluginError:
            continue
        if kind is law.config:
            return law
    raise TypeError(f"{kind.__name__} belongs to no law; the laws are {', '.join(REGISTERED)}")
