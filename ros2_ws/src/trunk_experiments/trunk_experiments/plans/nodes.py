"""The nodes of the project: executable, configuration, and the pure controller behind each law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trunk_control.config import FuzzyPidConfig, PidConfig
from trunk_control.controller import Controller, FuzzyPidController, PidController
from trunk_control.controller_config import ControllerConfig
from trunk_control.model_config import ComputedTorqueConfig, LqrConfig
from trunk_control.model_controller import ComputedTorqueController, LqrController
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import declarations
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig


@dataclass(frozen=True)
class NodeKind:
    """Where a node's executable lies and what it declares; its name is the executable's."""

    package: str
    config: type[Any]
    controller: type[Controller] | None = None


NODES: dict[str, NodeKind] = {
    "simulator": NodeKind("trunk_sim", SimulatorConfig),
    "disturbance": NodeKind("trunk_sim", DisturbanceConfig),
    "pid": NodeKind("trunk_control", PidConfig, PidController),
    "fuzzy_pid": NodeKind("trunk_control", FuzzyPidConfig, FuzzyPidController),
    "lqr": NodeKind("trunk_control", LqrConfig, LqrController),
    "computed_torque": NodeKind("trunk_control", ComputedTorqueConfig, ComputedTorqueController),
    "recorder": NodeKind("trunk_msgs_util", RecorderConfig),
}
CONTROLLERS = tuple(name for name, kind in NODES.items() if kind.controller is not None)


def declared_names() -> dict[str, tuple[str, ...]]:
    """Return each node's parameter names."""
    return {name: tuple(declarations(kind.config)) for name, kind in NODES.items()}


def make_controller(name: str, config: ControllerConfig) -> Controller:
    """Return a new controller of the named kind."""
    controller = NODES[name].controller
    if controller is None:
        raise ValueError(f"{name!r} is not a controller; there are {', '.join(CONTROLLERS)}")
    return controller(config)
