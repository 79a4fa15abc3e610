"""The nodes of a run as processes of a `World`: the very classes that the executables run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from . import rcl

if "rclpy" not in sys.modules:
    rcl.install()

import rclpy.utilities

from trunk_control.controller_node import ControllerNode
from trunk_control.laws import law_named
from trunk_core.parameters.declarations import declarations, values_of
from trunk_msgs_util import source
from trunk_msgs_util.node.execution import run_nodes
from trunk_msgs_util.node.recorder_node import RecorderNode
from trunk_recording import provenance
from trunk_runs.nodes import NODES
from trunk_runs.plan import RunPlan
from trunk_sim.disturbance_node import DisturbanceNode
from trunk_sim.simulator_node import SimulatorNode

from .story import NS, Request
from .world import Process, World, identity_of


def _creator(name: str) -> Callable[[], Any]:
    plain: dict[str, Callable[[], Any]] = {
        "simulator": SimulatorNode,
        "disturbance": DisturbanceNode,
        "recorder": RecorderNode,
    }
    return plain.get(name) or (lambda: ControllerNode(law_named(name)))


def parameters_of(name: str, config: Any) -> dict[str, tuple[str, Any]]:
    """Return a node's parameters as a parameter file gives them: type and value, by name."""
    return {
        key: (kind_of(name, key), list(value) if isinstance(value, tuple) else value)
        for key, value in values_of(config).items()
    }


def start(world: World, plan: RunPlan, name: str, **changed: Any) -> Process:
    """Begin a process with one of a plan's nodes; ``changed``: parameters by name."""
    given = parameters_of(name, plan.configs[name])
    for key, value in changed.items():
        given[key] = given[key][0], value
    creator = _creator(name)
    return world.start(name, lambda: run_nodes({name: creator}, name, [name]), {name: given})


def executable(name: str, argv: Sequence[str]) -> Callable[[], int]:
    """Return what a node's executable does, given its command line."""
    return lambda: run_nodes({name: _creator(name)}, name, argv)


def kind_of(name: str, key: str) -> str:
    """Return the type of a node's parameter as ROS 2 names it."""
    return declarations(NODES[name].config)[key].kind.upper().replace(" ", "_")


def new_world(seed: int) -> World:
    """Return a world in which nodes can be started; the one before it is over."""
    world = World(seed)
    rcl.state.world = world
    rcl.services.clear()
    rcl.state.stepped_ns = 0
    contexts: dict[int, Any] = {}
    last: list[Process] = []

    def switched(process: Process | None) -> None:
        if process is None:
            contexts[last.pop().number] = rclpy.utilities.g_default_context
        else:
            last.append(process)
            rclpy.utilities.g_default_context = contexts.get(process.number)

    world.switched = switched
    return world


def _as(function: Callable[..., Any], virtual: Callable[..., Any]) -> None:
    """Replace a function by a virtual one in every module of ours that has imported it by name."""
    for module in list(sys.modules.values()):
        if module.__name__.startswith("trunk_"):
            for name, value in list(vars(module).items()):
                if value is function:
                    setattr(module, name, virtual)


def _local_pid(identity: str) -> int | None:
    for process in rcl.world().processes:
        if process.identity == identity and process.alive:
            return process.number
    return None


_as(source.process_id, lambda pid=None: identity_of(pid) if pid else rcl.here().identity)
_as(source.same_machine, lambda identity: identity.startswith("virtual."))
_as(source.local_pid, _local_pid)


def _claimed(name: str) -> Held:
    holder = rcl.world().names.setdefault(name, rcl.here())
    if holder is not rcl.here() and holder.alive:
        raise source.HeldError(str(holder.number))
    rcl.world().names[name] = rcl.here()
    return Held()


class Held:
    """A name that a process holds until it ends."""

    def close(self) -> None: ...


_as(source.claimed, _claimed)
_ORIGIN = provenance.gather()
provenance._here()


def _gather(**told: str) -> dict[str, str]:
    """Return where a recording comes from; git is asked once, for it takes real time."""
    return {**_ORIGIN, **told}


provenance.gather = _gather


def call(world: World, *asked: Request) -> None:
    """Call a service soon, and then the others, each a while after the one before."""
    if not asked:
        return
    (service, kind, fields), *then = asked

    def ask() -> None:
        for one in rcl.services.get(service, []):
            one.ask(kind.Request(**fields), lambda answer: None)
        if then:
            world.at(world.delay(NS // 100, NS), lambda: call(world, *then))

    world.at(world.delay(500_000, 20_000_000), ask)


def log_of(processes: Mapping[str, Process] | list[Process]) -> str:
    """Return what the processes have said."""
    some = processes.values() if isinstance(processes, Mapping) else processes
    return "\n".join(f"[{one.name}] {line}" for one in some for line in one.log)
