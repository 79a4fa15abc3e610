"""Runs of the real nodes in this process, with what users do meanwhile: changes, resets, pauses, transitions.

The nodes, their topics and their services' callbacks are those of `trunk run --composed`; only the calls
come from this process, so that a run needs no second process to talk to it.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from trunk_core.parameters.declarations import Value
from trunk_msgs_util.node import middleware
from trunk_msgs_util.node.execution import LoopExecutor, _end  # the latter ends executables
from trunk_runs.composed_node import node_maker
from trunk_runs.plan import RunPlan

_SPINS = 100_000  # of the executor, some minutes: a run that hangs is ended
_IDLE_S = 0.002


class Action(NamedTuple):
    """What is done to a node once the simulator has reached a stamp."""

    stamp_ns: int
    node: str
    do: Callable[[Any], object]


def retune(stamp_ns: int, node: str, values: Mapping[str, Value]) -> Action:
    """Change parameters together; a set that is refused changes nothing."""
    changed = [
        Parameter(n, value=list(v) if isinstance(v, tuple) else v) for n, v in values.items()
    ]
    return Action(stamp_ns, node, lambda it: it.set_parameters_atomically(changed))


def reset(stamp_ns: int, node: str) -> Action:
    """Call the node's service ``~/reset``."""
    return Action(stamp_ns, node, lambda it: it._on_reset(Trigger.Request(), Trigger.Response()))


def pause(stamp_ns: int, hold: bool) -> Action:
    """Call the simulator's service ``~/pause``."""
    request = SetBool.Request(data=hold)
    return Action(stamp_ns, "simulator", lambda it: it._on_pause(request, SetBool.Response()))


def transition(stamp_ns: int, node: str, label: str) -> Action:
    """Make a lifecycle transition: ``deactivate``, ``activate``, ``cleanup`` or ``configure``."""
    return Action(stamp_ns, node, lambda it: getattr(it, f"trigger_{label}")())


def run(plan: RunPlan, path: Path, actions: Sequence[Action] = ()) -> bool:
    """Run the plan's nodes and record them; return True if the simulator has finished normally."""
    middleware.prepare()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    for name in ("rcl", "rcl_lifecycle"):
        set_logger_level(name, LoggingSeverity.FATAL)
    plan = replace(plan, recorder=replace(plan.recorder, output=str(path.absolute())))
    parameters = path.with_suffix(".yaml")
    plan.write_parameters(parameters)
    rclpy.init(
        args=["run", "--ros-args", "--log-level", "fatal", "--params-file", str(parameters)],
        signal_handler_options=SignalHandlerOptions.NO,
    )
    nodes = {name: node_maker(name)() for name in plan.configs}
    for node in nodes.values():
        node.autostart()
    executor = LoopExecutor()
    for node in nodes.values():
        executor.add_node(node)
    simulator = nodes["simulator"]
    todo = sorted(actions, key=lambda action: action.stamp_ns)
    for _ in range(_SPINS):
        if any(node.exit_code is not None for node in nodes.values()):
            break
        executor.spin_once(timeout_sec=_IDLE_S)
        while todo and simulator._running and simulator.run_stamp_ns >= todo[0].stamp_ns:
            action = todo.pop(0)
            action.do(nodes[action.node])
            executor._collect()  # a transition may have destroyed topics
    finished = simulator.exit_code == 0
    if not finished:  # a test that fails shows it
        print("ended by", {name: node.exit_code for name, node in nodes.items()})
    _end(list(nodes.values()), executor)
    return finished


def for_graph(plan: RunPlan, lockstep: bool, speed: float = 0.0) -> RunPlan:
    """Return a plan, made for an offline run, for the graph."""
    topics = ("effort_command", *(("disturbance",) if plan.disturbance else ()))
    turns = tuple(name for name, config in plan.controllers.items() if config.active_times)
    return replace(
        plan,
        simulator=replace(
            plan.simulator,
            autostart=True,
            lockstep=lockstep,
            lockstep_speed=speed,
            lockstep_timeout=60.0,
            lockstep_window=500,
            wait_for=(*topics, "recorder"),
            controllers=turns,
            publish_clock=False,
        ),
        controllers={
            name: replace(config, autostart=True, lockstep=lockstep)
            for name, config in plan.controllers.items()
        },
        disturbance=replace(plan.disturbance, autostart=True) if plan.disturbance else None,
        recorder=replace(
            plan.recorder,
            controllers=tuple(plan.controllers),
            scenario=plan.scenario,
            lockstep=lockstep,
            lockstep_topics=("ground_truth/joint_states", "joint_states", *topics),
        ),
    )
