"""Random parameters, messages, resets and jumps in time, through the real callbacks of real nodes.

Always: a command is finite and within the active limits, the stored parameters are the active ones,
nothing is raised, and counters only grow. The examples are the same each time; ``TRUNK_FUZZ=80`` makes
eighty times as many, different ones each time.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
import rclpy
from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import run_state_machine_as_test
from rclpy.signals import SignalHandlerOptions

from trunk_control.controller_node import ControllerNode
from trunk_control.laws import law_named
from trunk_msgs_util.node.base import TrunkNode
from trunk_sim.simulator_node import SimulatorNode

from .fuzzed_controllers import Controllers
from .fuzzed_node import Callbacks
from .fuzzed_simulator import Simulators

pytestmark = [pytest.mark.graph, pytest.mark.slow]

MORE = int(os.environ.get("TRUNK_FUZZ", "0"))
EXAMPLES, STEPS = 8, 50  # at most, of each node


def node_of(law: str) -> Callable[[], TrunkNode[Any]]:
    return partial(ControllerNode, law_named(law))


@pytest.fixture
def context(
    domain: int, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    # Each cleanup would wait for a recorder; there is none here.
    monkeypatch.setenv("TRUNK_PATIENCE", "0.001")
    rclpy.init(
        args=["--ros-args", "--log-level", "fatal", *request.param],
        signal_handler_options=SignalHandlerOptions.NO,
    )
    yield
    rclpy.try_shutdown()


LOCKSTEP = ("-p", "lockstep.enabled:=true")


@pytest.mark.timeout(600 * (1 + MORE))
@pytest.mark.parametrize(
    ("machine", "node", "context"),
    [
        (Controllers, node_of("pid"), ()),
        (Controllers, node_of("fuzzy_pid"), LOCKSTEP),
        (Controllers, node_of("lqr"), LOCKSTEP),
        (Controllers, node_of("computed_torque"), ()),
        (Simulators, SimulatorNode, LOCKSTEP),
    ],
    ids=["pid", "fuzzy_pid", "lqr", "computed_torque", "simulator"],
    indirect=["context"],
)
def test_whatever_comes(
    machine: type[Callbacks], node: Callable[[], TrunkNode[Any]], context: None
) -> None:
    fuzzed = type("Fuzzed", (machine,), {"node_class": node, "steps": Counter()})
    run_state_machine_as_test(
        fuzzed,
        settings=settings(
            max_examples=EXAMPLES * (MORE or 1),
            stateful_step_count=STEPS,
            derandomize=not MORE,
            database=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate, *([Phase.shrink] if MORE else [])],
        ),
    )
    assert fuzzed.steps["steps"] >= 40 * EXAMPLES
