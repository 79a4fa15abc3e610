"""The project's nodes: where each one's executable is, and what it declares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trunk_control.laws import CONTROLLERS, law_named
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import declarations
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig

__all__ = ["CONTROLLERS", "NODES", "NodeKind", "declared_names"]


@dataclass(frozen=True)
class NodeKind:
    """Where a node's executable is, and what it declares. Node and executable share their name."""

    package: str
    config: type[Any]


NODES: dict[str, NodeKind] = {
    "simulator": NodeKind("trunk_sim", SimulatorConfig),
    "disturbance": NodeKind("trunk_sim", DisturbanceConfig),
    **{name: NodeKind("trunk_control", law_named(name).config) for name in CONTROLLERS},
    "recorder": NodeKind("trunk_msgs_util", RecorderConfig),
}


def declared_names() -> dict[str, tuple[str, ...]]:
    """Return each node's parameter names."""
    return {name: tuple(declarations(kind.config)) for name, kind in NODES.items()}
