"""A branch's changes, applied to the plan of a resumed run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from trunk_control.controller import Controller
from trunk_control.controller_config import ControllerConfig
from trunk_control.reference_config import ReferenceConfig
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value, declarations, values_of
from trunk_msgs_util.parameters.files import Layer, Section, check_names
from trunk_msgs_util.units import nanoseconds, seconds
from trunk_sim.disturbance_config import DisturbanceConfig

from ..errors import PlanError
from ..plans.files import SCENARIOS, config_from, parse_setting, scenario_layers
from ..plans.nodes import CONTROLLERS, NODES, declared_names
from ..plans.plan import RunPlan, check_joints, check_rates
from ..plans.pushes import Push, parse_push, pushed
from ..plans.timeline import Change
from ..recorded.run import RecordedRun
from .branch import Branch
from .resume import Resumed

_TURNS = (Event.ACTIVATED, Event.DEACTIVATED, Event.CLEANED_UP)


class Branched(NamedTuple):
    """A resumed run with a branch's changes; ``new`` are the nodes that the parent does not have."""

    resumed: Resumed
    new: Mapping[str, Any]  # configurations at the start, by node


def branched(run: RecordedRun, resumed: Resumed, branch: Branch, until: float | None) -> Branched:
    """Return a resumed run with a branch's changes, to ``until`` s or as planned.

    A change to a controller or the disturbance acts on the state at the branch; a change to the simulator
    acts from that state on. Raises PlanError and ParameterError for impossible changes.
    """
    plan, at = resumed.plan, seconds(resumed.stamp_ns)
    if until is not None:
        if not until >= at:
            raise PlanError(f"--duration {until:g}: the branch begins at t = {at:g} s: give more")
        layer = Layer("--duration", (Section("simulator", {"duration": until}),))
        plan = replace(plan, simulator=_config(plan, "simulator", [layer], resumed.stamp_ns))
    new: dict[str, Any] = {}
    checkpoint = resumed.checkpoint
    if branch.controller:
        plan, config = _with_controller(plan, resumed, branch)
        if config is not None:
            new[branch.controller] = config
            controller = Controller(config)
            controller.deactivate()
            seen = _seen(run, config, resumed.stamp_ns)
            if seen is not None:
                controller.see(*seen)
            controllers = {**checkpoint.controllers, branch.controller: controller}
            checkpoint = checkpoint._replace(controllers=controllers)
    pushes = [parse_push(text, at) for text in branch.pushes]
    layers = [parse_setting(text) for text in branch.settings]
    check_names(layers, declared_names())
    named = {section.pattern for layer in layers for section in layer.sections}
    if plan.disturbance is None and (pushes or "disturbance" in named):
        simulator = plan.simulator
        quiet = DisturbanceConfig(update_rate=simulator.update_rate, joints=simulator.joints)
        plan = replace(plan, disturbance=quiet)
        new["disturbance"] = quiet
    changes = {node: list(node_changes) for node, node_changes in plan.changes.items()}
    before_ns = resumed.stamp_ns - plan.simulator.period_ns if resumed.first else -1
    for node in sorted(named):
        stamp_ns = resumed.stamp_ns if node == "simulator" else before_ns
        values = _changed(plan, node, layers, stamp_ns)
        if node == "disturbance" and pushes:
            continue  # with the pushes
        if values:
            changes.setdefault(node, []).append(Change(stamp_ns, values))
    if pushes:
        end = plan.simulator.duration
        config = _config(plan, "disturbance", layers, before_ns)
        made = pushed(config, pushes)
        _check_pushes(pushes, made, plan.changes.get("disturbance", ()), end)
        values = {**_changed(plan, "disturbance", layers, before_ns), **made}
        changes.setdefault("disturbance", []).append(Change(before_ns, values))
    plan = replace(
        plan, changes={node: node_changes for node, node_changes in changes.items() if node_changes}
    )
    check_joints(plan)
    check_rates(plan)
    return Branched(resumed._replace(plan=plan, checkpoint=checkpoint), new)


def _check_pushes(
    pushes: Sequence[Push], made: Mapping[str, Value], later: Sequence[Change], end: float
) -> None:
    """Raise PlanError for a push after the end, and for one that the parent would change later."""
    for push in pushes:
        if push.start > end:
            raise PlanError(f"--push at {push.start:g} s: the branch ends at t = {end:g} s")
    for change in later:
        undone = sorted(set(made) & set(change.values or ()))
        if undone:
            raise PlanError(
                f"--push: the run changes {', '.join(undone)} at "
                f"t = {seconds(change.stamp_ns):g} s, which would undo it: branch after that"
            )


def _in_force(plan: RunPlan, node: str, stamp_ns: int) -> Any:
    """Return a node's configuration after all that changed up to a stamp."""
    timeline = plan.timeline(node)
    timeline.advance(stamp_ns + 1)
    return timeline.config


def _config(plan: RunPlan, node: str, layers: Sequence[Layer], stamp_ns: int) -> Any:
    """Return a node's configuration after a stamp with the settings for it."""
    if node not in plan.configs:
        raise PlanError(
            f"--set {node}: it is not in the run, which has {', '.join(plan.configs)}"
            + ("; --controller adds a controller" if node in CONTROLLERS else "")
        )
    now = Layer("the recording", (Section(node, dict(values_of(_in_force(plan, node, stamp_ns)))),))
    return config_from(node, [now, *layers], "").config


def _changed(plan: RunPlan, node: str, layers: Sequence[Layer], stamp_ns: int) -> dict[str, Value]:
    """Return the parameters of a node that the settings change. Raises PlanError for fixed ones."""
    after = values_of(_config(plan, node, layers, stamp_ns))
    before = values_of(_in_force(plan, node, stamp_ns))
    changed = {name: value for name, value in after.items() if value != before[name]}
    declared = declarations(NODES[node].config)
    fixed = [name for name in changed if declared[name].fixed]
    if fixed:
        more = "; --duration gives the branch another end" if fixed == ["duration"] else ""
        raise PlanError(
            f"--set {node}.{fixed[0]}: it is fixed when a run starts: a branch can change only what "
            f"can be changed while the graph runs{more}"
        )
    return changed


def _with_controller(
    plan: RunPlan, resumed: Resumed, branch: Branch
) -> tuple[RunPlan, ControllerConfig | None]:
    """Return the plan with a controller that acts from the branch on, and its configuration if it is new."""
    name, at_ns = branch.controller, resumed.stamp_ns
    end_ns = nanoseconds(plan.simulator.duration)
    for node, config in plan.controllers.items():
        later = [seconds(t) for t in config.active_times_ns if at_ns <= t <= end_ns]
        if later:
            raise PlanError(
                f"--controller {name}: active.times of {node} has a turn at t = {later[0]:g} s that would "
                "undo it: branch after it"
            )
    acting = [n for n, controller in resumed.checkpoint.controllers.items() if controller.active]
    if acting == [name]:
        raise PlanError(f"--controller {name}: it already acts at t = {seconds(at_ns):g} s")
    changes = {
        node: [c for c in node_changes if c.values is not None or c.event not in _TURNS]
        for node, node_changes in plan.changes.items()
    }
    before_ns = at_ns - plan.simulator.period_ns if resumed.first else -1
    for node in acting:
        changes[node] = [Change(before_ns, None, Event.DEACTIVATED), *changes.get(node, [])]
    changes[name] = [Change(before_ns, None, Event.ACTIVATED), *changes.get(name, [])]
    controllers, new = dict(plan.controllers), None
    if name not in controllers:
        new = _new_controller(plan, name, acting)
        controllers[name] = new
    return replace(plan, controllers=controllers, changes=changes), new


def _new_controller(plan: RunPlan, name: str, acting: Sequence[str]) -> ControllerConfig:
    """Return the configuration of a controller that was not in the run: its scenario's, and what it tracks.

    Rate, joints, mode and reference are those of the controller whose place it takes.
    """
    layers = scenario_layers(plan.scenario) if plan.scenario in SCENARIOS else []
    first = next(iter(acting), plan.controller_name)
    model = plan.controllers.get(first) or _stand_in(plan)
    declared = declarations(NODES[name].config)
    taken = {
        key: value
        for key, value in values_of(model).items()
        if (key.startswith("reference.") or key in ("update_rate", "joint", "lockstep.enabled"))
        and key in declared
    }
    if "hip_joint" in declared:
        taken["hip_joint"] = plan.simulator.joints[0]
    layer = Layer("the recording", (Section(name, taken),))
    return config_from(name, [*layers, layer], "").config  # type: ignore[no-any-return]


def _stand_in(plan: RunPlan) -> ReferenceConfig:
    """Return the run's settings for a controller of ours that takes over from somebody else's."""
    given = plan.reference or ReferenceConfig(joint=plan.simulator.joints[1])
    rate, lockstep = plan.simulator.update_rate, plan.simulator.lockstep
    return replace(given, update_rate=rate, lockstep=lockstep)


def _seen(run: RecordedRun, config: ControllerConfig, stamp_ns: int) -> tuple[int, float] | None:
    """Return stamp, ns, and angle, rad, of the last measured state before a stamp; None at the start."""
    states = run.table(topics.JOINT_STATES)
    before_ns = stamp_ns - run.config("simulator").period_ns
    if before_ns not in states:
        return None
    return before_ns, states.get(before_ns, "position")[states.index(config.joint)]
