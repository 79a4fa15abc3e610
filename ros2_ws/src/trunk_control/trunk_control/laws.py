"""The registry of control laws: entry points of the group ``trunk.controllers``, including ours.

A package declares ``NAME = MODULE:LAW``. Executables, parameters, topics, labels, plans, sweeps and the
compiled loop follow from the law.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING

from trunk_msgs_util.errors import TrunkError

if TYPE_CHECKING:
    from .controller_config import ControllerConfig
    from .law import Law

GROUP = "trunk.controllers"
# In tables and plots these come first, in this order.
_FIRST = ("pid", "fuzzy_pid", "lqr", "computed_torque", "fuzzy")
_NODE_NAME = re.compile(r"[a-z][a-z0-9_]*")


class LawError(TrunkError):
    """A registered law cannot be used."""


@cache
def _registered() -> dict[str, list[EntryPoint]]:
    entries: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        entries.setdefault(entry.name, []).append(entry)
    rank = {name: i for i, name in enumerate(_FIRST)}
    return {
        name: entries[name] for name in sorted(entries, key=lambda n: (rank.get(n, len(rank)), n))
    }


REGISTERED = tuple(_registered())


def package_of(name: str) -> str:
    """Return the package that registered a law: the one whose executable runs its node."""
    return _package(_registered()[name][0])


@cache
def law_named(name: str) -> Law:
    """Return a law by its node's name.

    Raises KeyError for a name that is not registered, LawError for a law that cannot be used.
    """
    from .law import Law  # a node's executable needs only the names

    entries = sorted(_registered()[name], key=_package)  # a folder lists them in any order
    by = " and ".join(f"package {_package(entry)} ({entry.value})" for entry in entries)
    subject = f"controller {name!r} of {by}"
    if len(entries) > 1:
        raise LawError(f"{subject}: only one may have this name: uninstall or rename the other")
    if not _NODE_NAME.fullmatch(name):
        raise LawError(
            f"{subject}: a node's name is needed: lowercase letters, digits, underscores"
        )
    try:
        law = entries[0].load()
    except (Exception, SystemExit) as error:  # another project's module may raise anything
        reason = " ".join(str(error).split())
        raise LawError(f"{subject} cannot be loaded: {type(error).__name__}: {reason}") from error
    if not isinstance(law, Law):
        raise LawError(f"{subject} is {type(law).__name__}: a trunk_control.law.Law is needed")
    if law.name != name:
        raise LawError(
            f"{subject} calls itself {law.name!r}: entry point and law need the same name"
        )
    return law


def law_of(config: ControllerConfig) -> Law:
    """Return the law that a configuration belongs to. Raises TypeError if there is none."""
    for name in REGISTERED:
        try:
            law = law_named(name)
        except LawError:
            continue
        if type(config) is law.config:
            return law
    raise TypeError(
        f"{type(config).__name__} belongs to no law; the laws are {', '.join(REGISTERED)}"
    )


def _package(entry: EntryPoint) -> str:
    """Return the name of the package, as ROS 2 spells it."""
    return entry.dist.name.replace("-", "_") if entry.dist else "unknown"
