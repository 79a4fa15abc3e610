"""The node set for ``ros2 launch``: arguments and command lines; pure, ``launch`` is not needed."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import Recording, RecordingError

from ..errors import PlanError
from ..plans.nodes import CONTROLLERS, NODES
from ..plans.plan import RunPlan, make_plan

RECORDER = "recorder"
SIMULATOR = "simulator"
# Of the launch file, NAME:=VALUE: the default, and what it is. More goes into parameter files.
ARGUMENTS = {
    "scenario": ("demo", "fig6, fig7, fig8, fig9, demo, or a parameter file's path"),
    "controller": ("fuzzy_pid", f"one of {', '.join(CONTROLLERS)}"),
    "params": (
        "",
        "parameter files by path or shipped name, separated by commas; later ones win",
    ),
    "lockstep": ("false", "step when every node has answered: the same bits each time"),
    "output": ("", "folder for the recording; empty: runs/TIME_SCENARIO_CONTROLLER"),
}


@dataclass(frozen=True)
class LaunchNode:
    """One process: where its executable lies, and what follows ``--ros-args``."""

    package: str
    executable: str
    ros_arguments: tuple[str, ...]


def launch_plan(given: Mapping[str, str]) -> RunPlan:
    """Return the plan that the launch arguments ask for. Raises what `make_plan` does."""
    lockstep = given["lockstep"].strip().lower()
    if lockstep not in ("true", "false"):
        raise PlanError(f"lockstep:={given['lockstep']} is not allowed: true or false")
    return make_plan(
        given["scenario"],
        given["controller"],
        [part.strip() for part in given["params"].split(",") if part.strip()],
        everywhere={"lockstep.enabled": True} if lockstep == "true" else {},
    )


def _in_namespace(namespace: str) -> tuple[str, ...]:
    # /clock is the one absolute topic that a second simulator would spoil; /diagnostics names its nodes.
    return ("-r", f"__ns:={namespace}", "-r", "/clock:=clock") if namespace else ()


def launch_nodes(plan: RunPlan, parameters: Path) -> list[LaunchNode]:
    """Return the nodes of a run in the order of their start, the recorder first."""
    arguments = ("--params-file", str(parameters), *_in_namespace(plan.namespace))
    return [LaunchNode(NODES[name].package, name, arguments) for name in plan.configs]


def next_to_stop(running: Sequence[str]) -> list[str]:
    """Return the nodes to stop next once one has ended; empty: the rest may go.

    The simulator goes first, so that the others hear its end, and the recorder last, so that it hears all.
    """
    if SIMULATOR in running:
        return [SIMULATOR]
    return [name for name in running if name != RECORDER]


def what_lacks(file: Path) -> str:
    """Return why a run's recording is not whole, naming it; empty for a complete one."""
    try:
        recording = Recording.open_by_summary(file)
    except RecordingError as error:
        return str(error)
    if recording.complete:
        return ""
    return f"{file}: incomplete: {(recording.end or {}).get('reason', 'no end marker')}"


def connection_lines(plan: RunPlan) -> list[str]:
    """Return in five lines what a node that gives the commands subscribes to and publishes."""
    hip, trunk = plan.simulator.joints
    kind = topics.JOINT_STATE_TYPE
    at = f"{plan.namespace}/"
    reference = (
        f"{kind}: {trunk}, position [rad], of the state with its stamp, one step ahead"
        if plan.reference is not None
        else f"{kind}: nobody of ours publishes it (reference.profile is topic)"
    )
    rule = (
        "the state's, copied: it answers that state, and the plant waits for it"
        if plan.simulator.lockstep
        else "the state's, copied: it answers that state; without one it acts when it arrives"
    )
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    return [
        f"connect your node, with ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE={reach}:",
        f"  hears {at}{topics.JOINT_STATES}: {kind}: {hip}, {trunk}, position [m, rad], velocity; reliable",
        f"  hears {at}{topics.REFERENCE}: {reference}; reliable",
        f"  sends {at}{topics.EFFORT_COMMAND}: {kind}: {trunk}, effort [N m]; reliable or best effort",
        f"  header.stamp of a command: {rule}",
    ]
