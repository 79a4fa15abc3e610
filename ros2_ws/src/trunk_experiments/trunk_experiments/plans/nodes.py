"""The project's nodes: where each one's executable is, and what it declares."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from traceback import extract_tb
from typing import Annotated, Any, NamedTuple

from trunk_control.laws import REGISTERED, LawError, law_named, package_of
from trunk_control.reference import ReferenceConfig
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import Value, listed
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig

# What is not a controller's name.
OTHERS = ("simulator", "disturbance", "reference", "recorder", "markers")


@dataclass(frozen=True)
class NodeKind:
    """Where a node's executable is, what it declares, its class. Node and executable share their name."""

    package: str
    config: type[Any]
    node: str = "trunk_control.controller_node:ControllerNode"


def _usable() -> tuple[dict[str, NodeKind], dict[str, str]]:
    """Return the controllers that can be used, and why others cannot."""
    kinds, unusable = {}, {}
    for name in REGISTERED:
        try:
            if name in OTHERS:
                raise LawError(
                    f"controller {name!r} of package {package_of(name)}: another node has the name: rename it"
                )
            kinds[name] = NodeKind(package_of(name), law_named(name).config)
        except LawError as error:
            unusable[name] = str(error)
    return kinds, unusable


_CONTROLLERS, UNUSABLE = _usable()
CONTROLLERS = tuple(_CONTROLLERS)
NODES: dict[str, NodeKind] = {
    "simulator": NodeKind("trunk_sim", SimulatorConfig, "trunk_sim.simulator_node:SimulatorNode"),
    "disturbance": NodeKind(
        "trunk_sim", DisturbanceConfig, "trunk_sim.disturbance_node:DisturbanceNode"
    ),
    "reference": NodeKind(
        "trunk_control", ReferenceConfig, "trunk_control.reference_node:ReferenceNode"
    ),
    **_CONTROLLERS,
    "recorder": NodeKind(
        "trunk_msgs_util", RecorderConfig, "trunk_msgs_util.node.recorder_node:RecorderNode"
    ),
}


def unknown_controllers(names: Iterable[str]) -> str:
    """Return which of these controllers are not usable here, and what to do; empty if all are."""
    unknown = [name for name in names if name not in CONTROLLERS]
    if not unknown:
        return ""
    reasons = [UNUSABLE[name] for name in unknown if name in UNUSABLE]
    are = "is" if len(unknown) == 1 else "are"
    return "; ".join(
        [f"{', '.join(unknown)} {are} not known here: install the package that has it", *reasons]
    )


class Parameter(NamedTuple):
    """What a node declares about one parameter; numbers are in ``unit``, SI."""

    type: str
    default: Value
    unit: str
    allowed: str
    description: str
    fixed: Annotated[bool, "Only at start"]


def parameters_of(node: str) -> dict[str, Parameter]:
    """Return the declared parameters of a node, by name."""
    return {
        d.name: Parameter(d.kind, d.default, d.unit, d.allowed(), d.description, d.fixed)
        for d in listed(NODES[node].config).values()
    }


def declared_names() -> dict[str, tuple[str, ...]]:
    """Return, for each node, the names that a parameter file may set."""
    return {name: tuple(listed(kind.config)) for name, kind in NODES.items()}


_OURS = "trunk_control"


def fault_of_a_law(error: BaseException) -> str:
    """Return which law failed, how and where, if one of another package raised it; else empty."""
    for frame in reversed(extract_tb(error.__traceback__)):
        file = Path(frame.filename).resolve()
        for name, place in _places():
            if place == file or place in file.parents:
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                return (
                    f"controller {name!r}: {file}, line {frame.lineno}, in {frame.name}: {reason}; "
                    f"trunk controller check {name} tests it alone"
                )
    return ""


def _places() -> Iterator[tuple[str, Path]]:
    """Yield laws of other packages, each with its package's folder or, where it is one, its module's file."""
    for name in CONTROLLERS:
        update = law_named(name).update
        top = str(getattr(update, "__module__", "")).partition(".")[0]
        file = getattr(sys.modules.get(top), "__file__", None)
        if NODES[name].package != _OURS and top != _OURS and file is not None:
            path = Path(file).resolve()
            yield name, path.parent if path.name == "__init__.py" else path
