"""All nodes of a run in one process and one executor: the same classes, topics and bits, less waiting."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.run import run_nodes

_CLASSES = {
    "recorder": ("trunk_msgs_util.node.recorder_node", "RecorderNode"),
    "pid": ("trunk_control.pid_node", "PidNode"),
    "fuzzy_pid": ("trunk_control.fuzzy_pid_node", "FuzzyPidNode"),
    "lqr": ("trunk_control.lqr_node", "LqrNode"),
    "computed_torque": ("trunk_control.computed_torque_node", "ComputedTorqueNode"),
    "disturbance": ("trunk_sim.disturbance_node", "DisturbanceNode"),
    "simulator": ("trunk_sim.simulator_node", "SimulatorNode"),
}


def node_class(name: str) -> Callable[[], TrunkNode[Any]]:
    """Return the class of a node by its name."""
    module, cls = _CLASSES[name]
    found: Callable[[], TrunkNode[Any]] = getattr(import_module(module), cls)
    return found


def main() -> None:
    """Run the nodes named before ``--ros-args``, the recorder first."""
    split = sys.argv.index("--ros-args") if "--ros-args" in sys.argv else len(sys.argv)
    names = sys.argv[1:split]
    unknown = [name for name in names if name not in _CLASSES]
    if unknown or not names:
        print(
            f"composed: error: give nodes, of {', '.join(_CLASSES)}; not {', '.join(unknown) or 'none'}",
            file=sys.stderr,
        )
        sys.exit(2)
    sys.exit(run_nodes({name: node_class(name) for name in names}, "composed"))
