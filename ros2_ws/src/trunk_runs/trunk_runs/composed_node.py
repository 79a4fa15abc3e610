"""All nodes of a run in one process and executor: same classes, topics and bits, less waiting."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from trunk_control.laws import law_named
from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.execution import run_nodes

from .nodes import CONTROLLERS, NODES


def node_maker(name: str) -> Callable[[], TrunkNode[Any]]:
    """Return each node's factory, by name."""
    module, _, cls = NODES[name].node.partition(":")
    factory: Callable[..., TrunkNode[Any]] = getattr(import_module(module), cls)
    return partial(factory, law_named(name)) if name in CONTROLLERS else factory


def main() -> None:
    """Run the nodes named before ``--ros-args``, the recorder first."""
    split = sys.argv.index("--ros-args") if "--ros-args" in sys.argv else len(sys.argv)
    names = sys.argv[1:split]
    unknown = [name for name in names if name not in NODES]
    if unknown or not names:
        print(
            f"composed: error: give nodes from {', '.join(NODES)}, not {', '.join(unknown) or 'none'}",
            file=sys.stderr,
        )
        sys.exit(2)
    sys.exit(run_nodes({name: node_maker(name) for name in names}, "composed"))
