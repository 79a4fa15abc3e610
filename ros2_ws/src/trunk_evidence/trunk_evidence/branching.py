"""A branch: a recorded run as it was up to a time, and from then on with a change.

It is a run of the recorded plan that has the change in it. Up to then it must be the recorded one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trunk_control.law import ControllerConfig
from trunk_control.reference import ReferenceConfig
from trunk_core import topics
from trunk_core.errors import PlanError
from trunk_core.files import atomic_write, resolve_path
from trunk_core.parameters.declarations import Value, declarations, values_of
from trunk_core.parameters.parameter_files import Layer, Section, check_names
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.topics import Event
from trunk_core.units import nanoseconds, seconds
from trunk_recording.reader import RecordingError
from trunk_runs.nodes import CONTROLLERS, NODES, config_class, declared_names
from trunk_runs.offline_recording import Progress, record_offline
from trunk_runs.plan import RunPlan, check_joints, check_rates
from trunk_runs.scenario import SCENARIOS, config_from, parse_setting, scenario_layers
from trunk_runs.timeline import Change, Push, begins_active, parse_push, pushed
from trunk_sim.simulation import DivergedError

from .differences import FirstDifference, compare_topic
from .evidence import acts
from .recorded_run import AT, CHANGES, OF, PARENT, RecordedRun
from .repetition import plan_from, why_not_again
from .senders import TURNS


class Branch(NamedTuple):
    """What is other from ``at`` s on."""

    at: float
    settings: tuple[str, ...] = ()  # NODE.PARAM=VALUE
    controller: str = ""  # who acts from there on; empty: as recorded
    pushes: tuple[str, ...] = ()  # `timeline.parse_push`
    origin: str = "--set"  # of the settings, for messages

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


def branch_plan(run: RecordedRun, branch: Branch, until: float | None = None) -> RunPlan:
    """Return the plan of a branch, which ends at ``until`` s or as the recorded run was to.

    A change to a controller or the disturbance acts on the state at the branch; a change to the simulator
    acts from that state on. Raises PlanError and ParameterError for impossible changes, RecordingError for a
    run that cannot be taken up.
    """
    stamp_ns = _stamp_ns(run, branch)
    period_ns, at = run.config("simulator").period_ns, seconds(stamp_ns)
    plan = plan_from(run, stamp_ns // period_ns)
    if until is not None:
        if not until >= at:
            raise PlanError(f"--duration {until:g}: the branch begins at t = {at:g} s: give more")
        layer = Layer("--duration", (Section("simulator", {"duration": until}),))
        duration = _config(plan, "simulator", [layer], stamp_ns).duration
        plan = replace(plan, simulator=replace(plan.simulator, duration=duration))
    name, known = branch.controller, plan.controllers
    if name:
        plan = _with_controller(run, plan, name, stamp_ns)
    layers = [parse_setting(text, branch.origin) for text in branch.settings]
    given = {section.pattern for layer in layers for section in layer.sections}
    if name and name not in {*known, *given} and plan.scenario not in SCENARIOS:
        warning = (
            f"{name} has its defaults: {plan.scenario} is no shipped scenario: give --set {name}.…"
        )
        plan = replace(plan, warnings=(warning,))
    for layer in layers:
        if any(section.pattern == "reference" for section in layer.sections):
            raise PlanError(
                f"{layer.source}: a branch has no node reference: set CONTROLLER.reference.* instead"
            )
    pushes = [parse_push(text, at, plan.simulator.kind) for text in branch.pushes]
    plan = with_settings(plan, stamp_ns, layers, pushes)
    controllers = {name: c for name, c in plan.controllers.items() if _ever_acts(plan, name)}
    plan = replace(plan, controllers=controllers)
    check_joints(plan)
    check_rates(plan)
    return plan


def with_settings(
    plan: RunPlan, stamp_ns: int, layers: Sequence[Layer], pushes: Sequence[Push] = ()
) -> RunPlan:
    """Return a plan with parameters that change, and pulses, from the state with a stamp on.

    A disturbance that the plan does not have begins there. Raises as `branch_plan` does.
    """
    check_names(layers, declared_names(plan.simulator.kind.name))
    before_ns = max(stamp_ns - plan.simulator.period_ns, -1)
    named = {section.pattern for layer in layers for section in layer.sections}
    if plan.disturbance is None and (pushes or "disturbance" in named):
        quiet = config_class("disturbance", values_of(plan.simulator))(
            update_rate=plan.simulator.update_rate, joints=plan.simulator.joints
        )
        plan = replace(plan, disturbance=quiet, disturbed_ns=stamp_ns)
    changes = {node: [*listed] for node, listed in plan.changes.items()}
    for node in sorted(named | ({"disturbance"} if pushes else set())):
        since_ns = stamp_ns if node == "simulator" else before_ns
        values = _changed(plan, node, layers, since_ns)
        if node == "disturbance" and pushes:
            made = pushed(_config(plan, node, layers, since_ns), pushes)
            later = [c for c in plan.changes.get(node, ()) if c.stamp_ns > since_ns]
            _check_pushes(pushes, made, later, plan.simulator.duration)
            values |= made
        if values:
            changes.setdefault(node, []).append(Change(since_ns, values))
    return replace(plan, changes={node: listed for node, listed in changes.items() if listed})


def _stamp_ns(run: RecordedRun, branch: Branch) -> int:
    """Return the stamp of the first state of a branch, ns. Raises as `branch_plan` does."""
    at, stamps = branch.at, run.table(topics.GROUND_TRUTH).stamp_ns
    reason = why_not_again(run, bool(branch.controller))
    if reason or not len(stamps):
        why = reason or "no true states recorded"
        raise RecordingError(f"{run.path}: it cannot be branched: {why}")
    first, last = seconds(int(stamps[0])), seconds(int(stamps[-1]))
    if not (first <= at <= last):
        raise PlanError(f"--at {at:g}: outside the run, t = {first:g} to {last:g} s")
    period_ns: int = run.config("simulator").period_ns
    return -(-nanoseconds(at) // period_ns) * period_ns


def _ever_acts(plan: RunPlan, name: str) -> bool:
    config = plan.controllers[name]
    turned = any(change.event == Event.ACTIVATED for change in plan.changes.get(name, ()))
    return config.autostart or bool(config.active_times) or turned


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
        origin = _origin(layers)
        more = origin == "--set" and node in CONTROLLERS
        raise PlanError(
            f"{origin} {node}: it is not in the run, which has {', '.join(plan.configs)}"
            + ("; --controller adds a controller" if more else "")
        )
    values = {PLANT_NAME: plan.simulator.kind.name, **values_of(_in_force(plan, node, stamp_ns))}
    now = Layer("the recording", (Section(node, values),))
    return config_from(node, [now, *layers], "").config


def _changed(plan: RunPlan, node: str, layers: Sequence[Layer], stamp_ns: int) -> dict[str, Value]:
    """Return the parameters of a node that the settings change. Raises PlanError for fixed ones."""
    if any(PLANT_NAME in section.values for layer in layers for section in layer.sections):
        raise _fixed(f"{_origin(layers)} {node}.{PLANT_NAME}")
    after = values_of(_config(plan, node, layers, stamp_ns))
    before = values_of(_in_force(plan, node, stamp_ns))
    changed = {name: value for name, value in after.items() if value != before[name]}
    declared = declarations(type(plan.configs[node]))
    fixed = [name for name in changed if declared[name].fixed]
    if fixed:
        origin = _origin(layers)
        more = (origin, fixed) == ("--set", ["duration"])
        advice = "; --duration gives the branch another end" if more else ""
        raise _fixed(f"{origin} {node}.{fixed[0]}", advice)
    return changed


def _origin(layers: Sequence[Layer]) -> str:
    """Return where a branch's settings come from, without the first one's own text."""
    return layers[0].source.split()[0]


def _fixed(given: str, more: str = "") -> PlanError:
    return PlanError(
        f"{given}: it is fixed when a run starts: a branch can change only what can be changed while the "
        f"graph runs{more}"
    )


def _with_controller(run: RecordedRun, plan: RunPlan, name: str, at_ns: int) -> RunPlan:
    """Return the plan with a controller that acts from a state on."""
    end_ns = nanoseconds(plan.simulator.duration)
    for node, config in plan.controllers.items():
        later = [seconds(t) for t in config.active_times_ns if at_ns <= t <= end_ns]
        if later:
            raise PlanError(
                f"--controller {name}: active.times of {node} has a turn at t = {later[0]:g} s that would "
                "undo it: branch after it"
            )
    acting = [node for node in plan.controllers if acts(run, node, np.array([at_ns]))[0]]
    if acting == [name]:
        raise PlanError(f"--controller {name}: it already acts at t = {seconds(at_ns):g} s")
    before_ns = max(at_ns - plan.simulator.period_ns, -1)
    changes = {
        node: [
            c
            for c in listed
            if c.values is not None or c.event not in TURNS or c.stamp_ns <= before_ns
        ]
        for node, listed in plan.changes.items()
    }
    # One whose only turns were later is idle until then.
    for node, config in plan.controllers.items():
        began = begins_active(config, plan.changes.get(node, ()))
        if began != begins_active(config, changes.get(node, ())):
            word = Event.ACTIVATED if began else Event.DEACTIVATED
            changes[node] = [Change(-1, None, word), *changes.get(node, [])]
    for node in acting:
        changes.setdefault(node, []).append(Change(before_ns, None, Event.DEACTIVATED))
    changes.setdefault(name, []).append(Change(before_ns, None, Event.ACTIVATED))
    plan = replace(plan, changes=changes)
    if name not in plan.controllers:
        config = _new_controller(plan, name, acting)
        plan = replace(plan, controllers={**plan.controllers, name: config})
    if plan.inputs is not None:
        states = run.table(topics.JOINT_STATES)
        if before_ns in states:  # what it sees before it takes over
            angle = states.get(before_ns, "position")[states.index(plan.controllers[name].joint)]
            seen = {**plan.inputs.seen, before_ns: angle}
            plan = replace(plan, inputs=replace(plan.inputs, seen=seen))
    return plan


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
    taken[PLANT_NAME] = plan.simulator.kind.name
    layer = Layer("the recording", (Section(name, taken),))
    return config_from(name, [*layers, layer], "").config  # type: ignore[no-any-return]


def _stand_in(plan: RunPlan) -> ReferenceConfig:
    """Return the run's settings for a controller of the project that takes over from an external one."""
    given = plan.reference or ReferenceConfig(joint=plan.simulator.joints[1])
    rate, lockstep = plan.simulator.update_rate, plan.simulator.lockstep
    return replace(given, update_rate=rate, lockstep=lockstep)


def record_branch(
    run: RecordedRun,
    branch: Branch,
    plan: RunPlan,
    path: Path,
    overwrite: bool = False,
    progress: Progress = lambda done, of: None,
) -> int:
    """Write the recording of a branch's plan; return the number of its states.

    Raises DivergedError (the file then ends, marked incomplete, with the last finite state), RecordingError
    (no file) for a run that does not verify up to the branch, and OSError.
    """
    origin = {
        OF: digest_of(run.recording.files),
        PARENT: resolve_path(run.path).name,
        AT: repr(branch.at),
        CHANGES: branch.describe(),
    }
    diverged, states = None, 0
    with atomic_write(path, overwrite=overwrite) as part:
        try:
            states = record_offline(plan, part, True, progress, origin)
        except DivergedError as error:
            diverged = error
        except PlanError as error:
            raise RecordingError(f"{run.path}: it cannot be branched: {error}") from None
        check_past(run, RecordedRun.open(part), _stamp_ns(run, branch))
    if diverged is not None:
        raise diverged
    return states


def check_past(run: RecordedRun, branch: RecordedRun, stamp_ns: int) -> None:
    """Raise RecordingError unless a branch is the run up to its state with a stamp, ns."""
    known = {
        topics.GROUND_TRUTH: stamp_ns,
        topics.JOINT_STATES: stamp_ns,
        **{topics.controller_state(name): stamp_ns - 1 for name in run.judgeable},
        **({} if run.external else {topics.EFFORT_COMMAND: stamp_ns - 1}),
        **({topics.DISTURBANCE: stamp_ns - 1} if "disturbance" in run.parameters else {}),
        **({topics.PLANT_INPUTS: stamp_ns - 1} if run.count(topics.PLANT_INPUTS) else {}),
    }
    differences: list[FirstDifference] = []
    for topic, last_ns in known.items():
        tables = (each.table(topic) for each in (run, branch))
        before = (table.rows(np.flatnonzero(table.stamp_ns <= last_ns)) for table in tables)
        differences += filter(None, compare_topic(topic, *before)[1:])
    reasons = [f"altered: {part}" for part in run.recording.alterations()]
    if differences:
        reasons.append(min(differences, key=lambda d: d.stamp_ns).describe())
    if reasons:
        raise RecordingError(
            f"{run.path}: it cannot be branched at t = {seconds(stamp_ns):g} s: it does not verify up to "
            f"there: {reasons[0]}"
        )


def digest_of(files: Iterable[Path]) -> str:
    """Return the SHA-256 of some files, one after the other, in hexadecimal digits."""
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while chunk := file.read(1 << 20):
                digest.update(chunk)
    return digest.hexdigest()
