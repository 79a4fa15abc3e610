"""What a branch changes, as the user asks for it, in words and for the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from trunk_control.controller import Controller
from trunk_control.controller_config import ControllerConfig
from trunk_control.reference import ReferenceConfig
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import Value, declarations, values_of
from trunk_msgs_util.parameters.files import Layer, Section, check_names
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.units import nanoseconds, seconds
from trunk_sim.disturbance_config import DisturbanceConfig

from ..errors import PlanError
from ..plans.files import SCENARIOS, config_from, parse_setting, scenario_layers
from ..plans.nodes import CONTROLLERS, NODES, declared_names
from ..plans.plan import RunPlan, check_joints, check_rates
from ..plans.pushes import Push, parse_push, pushed
from ..plans.timeline import Change, Timeline, begins_active
from ..recorded.plan import references_of, why_not_again
from ..recorded.processes import TURNS, Process
from ..recorded.run import RecordedRun, usable
from ..replay.checks import Check, describe
from ..replay.in_force import check_disturbances, check_inputs
from ..replay.rerun import Rerun
from ..runs.engine import Checkpoint


class Branch(NamedTuple):
    """One branch of a run: from ``at`` s on, with these changes."""

    at: float
    settings: tuple[str, ...] = ()  # NODE.PARAM=VALUE
    controller: str = ""  # who acts from there on; empty: as recorded
    pushes: tuple[str, ...] = ()  # `pushes.parse_push`

    def describe(self) -> str:
        """Return the changes in a line."""
        changes = [f"controller {self.controller}"] if self.controller else []
        changes += [*self.settings, *(f"push {push}" for push in self.pushes)]
        return ", ".join(changes) or "nothing changed"


def fanned(branches: Sequence[Branch], grid: Sequence[str]) -> list[Branch]:
    """Return each branch with each combination of the values of ``NODE.PARAM=A,B,C``.

    Raises PlanError for a text without values.
    """
    axes: list[list[str]] = []
    for text in grid:
        target, equals, values = text.partition("=")
        options = [value.strip() for value in values.split(",")]
        if not equals or not target or not all(options):
            raise PlanError(f"--grid {text!r}: NODE.PARAM=A,B,C is needed")
        axes.append([f"{target}={value}" for value in options])
    return [
        branch._replace(settings=(*branch.settings, *chosen))
        for branch in branches
        for chosen in product(*axes)
    ]


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
        node: [c for c in node_changes if c.values is not None or c.event not in TURNS]
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


class Resumed(NamedTuple):
    """A run before the state with index ``first``.

    The plan has the configurations in force there, and what happens from there on. ``sources``: of the nodes
    that go on, by name, in a real-time run. ``commander``: the controller that gave the last command.
    """

    plan: RunPlan
    checkpoint: Checkpoint
    first: int
    stamp_ns: int
    sources: Mapping[str, str]
    commander: str
    commands: Mapping[str, int]  # how many each controller has given before


def state_at(run: RecordedRun, at: float, commanded: bool = False) -> int:
    """Return the index of the first state at or after a time in s.

    ``commanded``: the branch names a controller of ours that takes over.

    Raises PlanError if the time is outside of the run, RecordingError for a run that cannot be taken up.
    """
    if reason := why_not_again(run, commanded):
        raise RecordingError(f"{run.path}: it cannot be branched: {reason}")
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    first, last = (seconds(int(stamps[i])) for i in (0, -1))
    if not (first <= at <= last):
        raise PlanError(f"--at {at:g}: outside the run, t = {first:g} to {last:g} s")
    period_ns: int = run.config("simulator").period_ns
    return -(-nanoseconds(at) // period_ns)


def resumed(run: RecordedRun, first: int) -> Resumed:
    """Return a run before its state with this index.

    Raises RecordingError if the record does not verify up to there.
    """
    stamp_ns = first * run.config("simulator").period_ns
    if altered := run.recording.alterations():
        raise _refused(run, stamp_ns, f"altered: {altered[0]}")
    rerun = Rerun(run)
    _check_whole(run, rerun, stamp_ns)
    rerun.compare(stamp_ns - 1)
    checks = [*rerun.checks]
    for process in run.processes("disturbance") if run.count(topics.DISTURBANCE) else ():
        if process.parameters:
            checks.append(check_disturbances(run, process, stamp_ns - 1))
    if rerun.inputs.recorded:
        checks.append(check_inputs(run, rerun, stamp_ns - 1))
    faulty = [check for check in checks if check.first or check.unjudged]
    if faulty:
        earliest = min(
            faulty, key=lambda check: check.first[0].stamp_ns if check.first else stamp_ns
        )
        raise _refused(run, stamp_ns, _fault(earliest))
    checkpoint = rerun.engine.checkpoint()
    _check_state(run, rerun, checkpoint, stamp_ns)
    processes = _going_on(run, rerun, stamp_ns)
    controllers = {}
    for name in run.parameters:
        if name not in usable() or name not in processes:
            continue
        label = next((key for key, a in rerun.answers.items() if a.process is processes[name]), "")
        if label:
            controllers[name] = checkpoint.controllers[label]
        else:  # it has not given a command, but it exists
            controllers[name] = _idle(processes[name], run, stamp_ns)
    checkpoint = checkpoint._replace(controllers=controllers)
    sources = {name: process.source for name, process in processes.items()}
    plan = _plan(run, rerun, checkpoint, processes, stamp_ns)
    commands = {
        answers.process.node: answers.check.steps
        for answers in rerun.answers.values()
        if answers.process is processes.get(answers.process.node)
    }
    commander = _commander(run, processes, stamp_ns)
    return Resumed(plan, checkpoint, first, stamp_ns, sources, commander, commands)


def _fault(check: Check) -> str:
    return (
        describe(check.first[0])
        if check.first
        else f"{check.name}: {check.unjudged} steps not judged"
    )


def _refused(run: RecordedRun, stamp_ns: int, reason: str) -> RecordingError:
    return RecordingError(
        f"{run.path}: it cannot be branched at t = {seconds(stamp_ns):g} s: it does not verify up to there: "
        f"{reason}"
    )


def _check_whole(run: RecordedRun, rerun: Rerun, stamp_ns: int) -> None:
    """Raise RecordingError unless every state up to a stamp is there."""
    before = rerun.stamps[rerun.stamps <= stamp_ns]
    period_ns = run.config("simulator").period_ns
    gaps = np.flatnonzero(before != np.arange(len(before)) * period_ns)
    if len(gaps) or not len(before) or before[-1] != stamp_ns:
        at = seconds(int(gaps[0] if len(gaps) else len(before)) * period_ns)
        raise _refused(run, stamp_ns, f"states are missing from t = {at:g} s")


def _check_state(run: RecordedRun, rerun: Rerun, checkpoint: Checkpoint, stamp_ns: int) -> None:
    """Raise RecordingError unless the state at a stamp is the one that the run leads to."""
    check = rerun.check_state(checkpoint.state.trunk, stamp_ns)
    if check.first:
        raise _refused(run, stamp_ns, _fault(check))


def _going_on(run: RecordedRun, rerun: Rerun, stamp_ns: int) -> dict[str, Process]:
    """Return the process of each node that the branch goes on with: the last one configured before it."""
    going: dict[str, Process] = {"simulator": rerun.simulator}
    for name in run.parameters:
        for process in run.processes(name) if name not in ("simulator", "recorder") else ():
            began = [e.stamp_ns for e in process.events if e.message == Event.CONFIGURED]
            if process.parameters and (not began or began[0] < stamp_ns):
                going[name] = process
    return going


def _idle(process: Process, run: RecordedRun, stamp_ns: int) -> Controller:
    """Return a controller that has not answered any state before a stamp, but has seen them."""
    timeline = Timeline(process.config, process.changes)
    controller = Controller(process.config)
    if not begins_active(process.config, process.changes):
        controller.deactivate()
    timeline.advance(stamp_ns, controller)
    before_ns = stamp_ns - run.config("simulator").period_ns
    states = run.table(topics.JOINT_STATES)
    if not controller.active and before_ns in states:
        place = states.index(process.config.joint)
        controller.see(before_ns, states.get(before_ns, "position")[place])
    return controller


def _commander(run: RecordedRun, processes: Mapping[str, Process], stamp_ns: int) -> str:
    """Return the controller that gave the last command before a stamp; empty if none did."""
    last: dict[str, int] = {}
    for name, process in processes.items():
        if name in run.controllers:
            terms = run.table(topics.controller_state(name))
            stamps = process.stamps(terms)
            last[name] = int(stamps[stamps < stamp_ns].max(initial=-1))
    name = max(last, key=lambda name: last[name], default="")
    return name if last.get(name, -1) >= 0 else ""


def _plan(
    run: RecordedRun,
    rerun: Rerun,
    checkpoint: Checkpoint,
    processes: Mapping[str, Process],
    stamp_ns: int,
) -> RunPlan:
    """Return the plan from a stamp on, to the time that was planned, or else to the last state."""
    simulator, planned = checkpoint.simulator, rerun.simulator.config.duration
    last = int(run.table(topics.GROUND_TRUTH).stamp_ns.max())
    changes: dict[str, list[Change]] = {"simulator": rerun.engine.to_come().get("simulator", [])}
    disturbance = reference = None
    for name, process in processes.items():
        if name == "simulator":
            continue
        timeline = Timeline(process.config, process.changes)
        timeline.advance(stamp_ns)
        changes[name] = timeline.to_come
        if name == "disturbance":
            disturbance = timeline.config
        if name == "reference":
            reference = timeline.config
    if "recorder" in run.parameters:
        recorder = run.config("recorder")
    else:
        pictures = any(run.recording.topic(n) in run.recording.topics for n in topics.PICTURES)
        recorder = RecorderConfig(controllers=tuple(checkpoint.controllers), markers=pictures)
    return RunPlan(
        scenario=run.recording.provenance.get("scenario", ""),
        simulator=replace(simulator, duration=planned or seconds(last)),
        controllers={
            name: controller.config for name, controller in checkpoint.controllers.items()
        },
        disturbance=disturbance,
        recorder=recorder,
        namespace=run.recording.namespace,
        changes={name: later for name, later in changes.items() if later},
        references=references_of(run),
        pushes=run.operated.pushes,
        external=run.external or None,
        reference=reference,
    )
