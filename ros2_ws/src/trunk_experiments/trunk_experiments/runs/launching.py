"""The node set for ``ros2 launch``: arguments and command lines; pure, ``launch`` is not needed."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import UnitError
from trunk_msgs_util.parameters.to_si import number_in
from trunk_msgs_util.recording.reader import Recording, RecordingError

from ..errors import PlanError
from ..plans.files import checked_external, checked_namespace
from ..plans.nodes import CONTROLLERS, NODES
from ..plans.plan import RunPlan, make_plan, parse_swap

_UNITS = {"speed": "", "rate": "Hz", "duration": "s"}  # of the arguments that are numbers
RECORDER = "recorder"
SIMULATOR = "simulator"


@dataclass(frozen=True)
class LaunchArgument:
    """An argument of the launch file: ``name:=value``."""

    name: str
    default: str
    description: str


ARGUMENTS = (
    LaunchArgument("scenario", "demo", "fig6, fig7, fig8, fig9, demo, or a parameter file's path"),
    LaunchArgument("controller", "fuzzy_pid", f"one of {', '.join(CONTROLLERS)}"),
    LaunchArgument(
        "external",
        "",
        "the name of a run whose commands your own node gives; true: the node's own name; empty: one of ours",
    ),
    LaunchArgument(
        "lockstep", "false", "step when every node has answered: the same bits each time"
    ),
    LaunchArgument("speed", "", "pace of a lock-step run, as a multiple of real time; empty: none"),
    LaunchArgument(
        "params", "", "parameter files by path or shipped name, separated by commas; later ones win"
    ),
    LaunchArgument(
        "swap_at", "", "T:CONTROLLER takes over at T s; several are separated by commas"
    ),
    LaunchArgument("rate", "", "update_rate of simulator and controller, Hz; empty: the files'"),
    LaunchArgument("duration", "", "simulated time, s; 0: until Ctrl-C; empty: the files'"),
    LaunchArgument("namespace", "", "of all nodes, so that several sets run side by side"),
    LaunchArgument("output", "", "folder for the recording; empty: runs/TIME_SCENARIO_CONTROLLER"),
    LaunchArgument("markers", "", "publish visualization markers; empty: where RViz is started"),
    LaunchArgument("rviz", "false", "start RViz with the shipped view"),
)


@dataclass(frozen=True)
class LaunchNode:
    """One process: where its executable lies, its own options, and what follows ``--ros-args``."""

    package: str
    executable: str
    ros_arguments: tuple[str, ...]
    options: tuple[str, ...] = ()


def flag(given: Mapping[str, str], name: str, default: bool = False) -> bool:
    """Return an argument that is true or false; empty: the default. Raises PlanError."""
    text = given[name].strip().lower()
    if text in ("true", "1"):
        return True
    if text in ("false", "0"):
        return False
    if text:
        raise PlanError(f"{name}:={given[name]} is not allowed: true or false")
    return default


def _number(given: Mapping[str, str], name: str) -> float:
    try:
        return number_in(given[name], _UNITS[name])
    except UnitError as error:
        raise PlanError(f"{name}:={given[name]} is not allowed: {error}") from None


def _listed(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def launch_plan(given: Mapping[str, str]) -> RunPlan:
    """Return the plan that the launch arguments ask for. Raises what `make_plan` does."""
    everywhere: dict[str, object] = {}
    if flag(given, "lockstep"):
        everywhere["lockstep.enabled"] = True
    targets = {"speed": "lockstep.speed", "rate": "update_rate", "duration": "duration"}
    everywhere |= {
        parameter: _number(given, name) for name, parameter in targets.items() if given[name]
    }
    external = given["external"].strip() or None
    if external is not None:
        external = "" if external.lower() in ("true", "1") else checked_external(external)
        if given["swap_at"]:
            raise PlanError("external: your own node gives the commands: leave out swap_at")
    plan = make_plan(
        given["scenario"],
        given["controller"],
        _listed(given["params"]),
        everywhere=everywhere,
        namespace=checked_namespace(given["namespace"]),
        swaps=[parse_swap(text) for text in _listed(given["swap_at"])],
        external=external,
    )
    if given["speed"] and not plan.simulator.lockstep:
        raise PlanError(
            f"speed:={given['speed']}: only a lock-step run can be paced: give lockstep:=true"
        )
    return plan


def _in_namespace(namespace: str) -> tuple[str, ...]:
    # /clock is the one absolute topic that a second simulator would spoil; /diagnostics names its nodes.
    return ("-r", f"__ns:={namespace}", "-r", "/clock:=clock") if namespace else ()


def launch_nodes(plan: RunPlan, parameters: Path) -> list[LaunchNode]:
    """Return the nodes of a run in the order of their start, the recorder first."""
    arguments = ("--params-file", str(parameters), *_in_namespace(plan.namespace))
    return [LaunchNode(NODES[name].package, name, arguments) for name in plan.configs]


def launch_viewers(plan: RunPlan, given: Mapping[str, str], share: Path) -> list[LaunchNode]:
    """Return the viewers of a run, which take no part in it; ``share`` is this package's share folder."""
    rviz = flag(given, "rviz")
    place = _in_namespace(plan.namespace)
    viewers = []
    if rviz:  # first: where it is not installed, nothing has been started yet
        # The view names its topics absolutely, as RViz does.
        view = share / "rviz" / "trunk.rviz"
        remap = ("-r", "/markers:=markers") if plan.namespace else ()
        viewers.append(LaunchNode("rviz2", "rviz2", (*remap, *place), ("-d", str(view))))
    if flag(given, "markers", default=rviz):
        viewers.append(LaunchNode("trunk_experiments", "markers", place))
    return viewers


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
