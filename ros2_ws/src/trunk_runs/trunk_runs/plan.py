"""A run's plan: which nodes, with which values, from a scenario, parameter files and a command line.

Offline runs and the graph use the same plan, so that both run the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from dataclasses import replace as with_values
from math import degrees, inf, isfinite, pi
from pathlib import Path
from typing import Any, NamedTuple

from trunk_control.decide import active_at
from trunk_control.law import ControllerConfig
from trunk_control.reference import ReferenceConfig
from trunk_core.errors import PlanError, closest, did_you_mean
from trunk_core.parameters.declarations import UnitError, declarations, values_of
from trunk_core.parameters.parameter_files import (
    Layer,
    Section,
    check_names,
    qos_overrides,
    read,
    write,
)
from trunk_core.parameters.shared import PLANT_NAME, RecorderConfig
from trunk_core.parameters.to_si import number_in
from trunk_core.text import printable
from trunk_core.topics import EXTERNAL
from trunk_core.units import seconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.plant import TRUNK, Plant

from .nodes import CONTROLLERS, NODES, declared_names, why_not_with
from .scenario import config_from, find_file, parse_setting, plant_of, scenario_layers
from .timeline import Change, GivenInputs, Pushes, Timeline, with_pushes


class Swap(NamedTuple):
    """A controller that takes over at a time in s."""

    time: float
    controller: str


def turns_of(first: str, swaps: Sequence[Swap]) -> dict[str, tuple[float, ...]]:
    """Return each controller's ``active.times``, by name in the order of their first turns.

    Raises PlanError for swaps whose times do not ascend, or that change nothing.
    """
    turns: dict[str, list[float]] = {first: [0.0]}
    now, acting = 0.0, first
    for time, name in swaps:
        if time <= now:
            raise PlanError(
                f"swap at {time:g}:{name}: times must be above 0 and ascend; the previous is {now:g}"
            )
        if name == acting:
            raise PlanError(f"swap at {time:g}:{name}: {name} is already acting then")
        turns[acting].append(time)
        turns.setdefault(name, []).append(time)
        now, acting = time, name
    return {name: tuple(times) for name, times in turns.items()}


def parse_swap(text: str) -> Swap:
    """Return the swap that ``T:CONTROLLER`` stands for, T in s or with a unit. Raises PlanError."""
    time_text, colon, name = text.partition(":")
    wrong = ""
    try:
        time = number_in(time_text, "s")
        if colon and name in CONTROLLERS and isfinite(time):
            return Swap(time, name)
    except UnitError as error:
        wrong = f"; T is {time_text!r}: {error}"
    raise PlanError(
        f"swap at {text!r}: T:CONTROLLER is needed, T in s, "
        f"CONTROLLER one of {', '.join(CONTROLLERS)}{wrong}"
    )


def check_targets(settings: Iterable[Layer], taking: Sequence[str]) -> None:
    """Raise PlanError for a single value that no node of the run takes."""
    for layer in settings:
        node = layer.sections[0].pattern
        if node not in taking:
            acting = ", ".join(name for name in taking if name in CONTROLLERS)
            raise PlanError(
                f"{layer.source}: no node of this run takes it: {acting} acts; "
                f"give --controller {node}, or name another node: {', '.join(taking)}"
            )


def not_taken(files: Iterable[Layer], taking: Sequence[str], namespace: str = "") -> Iterator[str]:
    """Yield a warning for each file that changes nothing, and each misspelt node.

    ``files``: their relative node names are in the ``namespace`` already.
    """
    for layer in files:
        used = [
            s for s in layer.sections if any(s.matches(f"{namespace}/{node}") for node in taking)
        ]
        names = list(dict.fromkeys(s.last_token for s in layer.sections))
        for name in names:
            meant = closest(name, NODES)
            if name not in NODES and "*" not in name and meant:
                yield f"{layer.source}: no node is called {name!r}; did you mean {meant!r}?"
        if not used:
            patterns = dict.fromkeys(s.pattern for s in layer.sections)
            full = namespace or any("/" in pattern for pattern in patterns)
            nodes = [f"{namespace}/{node}" if full else node for node in taking]
            line = (
                f"{layer.source}: no node of this run uses anything in it: it is for "
                f"{', '.join(patterns)}; the run has {', '.join(nodes)}"
            )
            elsewhere = [s for s in layer.sections if s.last_token in taking]
            if elsewhere:
                name = elsewhere[0].last_token
                above = "/" + elsewhere[0].pattern.strip("/").rpartition("/")[0]
                line += f": call the section {name}, or run in the namespace {above}"
            yield line


def suspicious_units(
    configs: Mapping[str, Any], with_units: Mapping[str, Collection[str]]
) -> Iterator[str]:
    """Yield a warning for each angle of more than a turn, and each length beyond a limb's.

    They were most likely meant in degrees, and in centimetres. ``with_units``: by node, the parameters in
    whose values a unit is written: those are meant.
    """
    for node, config in configs.items():
        values = values_of(config)
        for name, declared in declarations(type(config)).items():
            if name in with_units.get(node, ()) or values[name] == declared.default:
                continue
            for value in _angles(name, declared.unit, values[name]):
                if 2.0 * pi < abs(value) < 1e300:
                    yield (
                        f"{node}: {name} is {value:g} rad, which is {degrees(value):.0f} degrees: "
                        "angles are in radians, unless given with a unit, such as 30 deg"
                    )
            if name in _LENGTHS and values[name] > LONGEST:  # type: ignore[operator]
                yield (
                    f"{node}: {name} is {values[name]:g} m: lengths are in metres, unless given with a unit, "
                    "such as 60 cm"
                )


LONGEST = 10.0  # m
_LENGTHS = ("plant.length", "model.length")


def _angles(name: str, unit: str | None, value: Any) -> list[float]:
    if name == "initial.position":
        return [value[1]]
    if unit != "rad":
        return []
    return [angle for angle in (value if isinstance(value, tuple) else (value,)) if isfinite(angle)]


@dataclass(frozen=True)
class RunPlan:
    """Everything that decides a run: resolved configurations, and what happens when.

    The graph, offline runs, replays, `simulate --like` and sweeps share it.
    """

    scenario: str
    simulator: SimulatorConfig
    controllers: Mapping[str, ControllerConfig]  # by node name, the first to act first
    disturbance: DisturbanceConfig | None  # None: nothing disturbs
    recorder: RecorderConfig
    warnings: tuple[str, ...] = ()
    namespace: str = ""  # of all nodes: empty, or "/name"
    # What came from outside during a recorded run: changes by node, references [rad] by stamp.
    changes: Mapping[str, Sequence[Change]] = field(default_factory=dict)
    references: Mapping[int, float] = field(default_factory=dict)
    pushes: Pushes = ()  # what was taken from an operator
    # Somebody else's node gives the commands; the run goes by this name, or the node's own. None: ours do.
    external: str | None = None
    reference: ReferenceConfig | None = (
        None  # published for that node; None: by another node, or not at all
    )
    inputs: GivenInputs | None = None  # None: every message acts on its own state
    disturbed_ns: int = 0  # the stamp of the disturbance's first message
    qos_overrides: Mapping[str, Mapping[str, object]] = field(default_factory=dict)  # by node

    @property
    def controller_name(self) -> str:
        """The controller that acts first."""
        return next(iter(self.controllers), self.external or EXTERNAL)

    @property
    def controller(self) -> ControllerConfig:
        """The configuration of the controller that acts first."""
        return self.controllers[self.controller_name]

    def with_controller(self, config: ControllerConfig) -> RunPlan:
        """Return the plan with another configuration of the controller that acts first."""
        return with_values(self, controllers={**self.controllers, self.controller_name: config})

    def timeline(self, node: str) -> Timeline:
        """Return a node's configuration and its changes during the run."""
        return Timeline(self.configs[node], self.changes.get(node, ()))

    @property
    def turns(self) -> str:
        """The controllers' names in the order of their first turns: ``pid``, ``pid, fuzzy_pid``."""
        return ", ".join(self.controllers) or self.controller_name

    @property
    def configs(self) -> dict[str, Any]:
        """The configurations of the nodes that run, by node name."""
        optional = {"disturbance": self.disturbance, "reference": self.reference}
        return {
            "recorder": self.recorder,
            **self.controllers,
            **{name: config for name, config in optional.items() if config is not None},
            "simulator": self.simulator,
        }

    def unrecorded(self) -> RunPlan:
        """Return the plan of the same run without its recorder, and without waiting for it."""
        wait_for = tuple(name for name in self.simulator.wait_for if name != "recorder")
        return with_values(self, simulator=with_values(self.simulator, wait_for=wait_for))

    def write_parameters(self, path: Path) -> None:
        """Write the whole plan as one ROS 2 parameter file, by fully qualified node names."""
        write(
            path,
            {
                f"{self.namespace}/{name}": {**values_of(c), **self.qos_overrides.get(name, {})}
                for name, c in self.configs.items()
            },
        )


# What options and arguments call the parameters that they set for all nodes.
_GIVEN_AS = {"update_rate": "rate", "lockstep.enabled": "lockstep", "lockstep.speed": "speed"}


def make_plan(
    scenario: str | Layer,
    controller: str,
    params: Sequence[str] = (),
    settings: Sequence[str | Layer] = (),
    everywhere: Mapping[str, object] | None = None,
    namespace: str = "",
    swaps: Sequence[Swap] = (),
    others: Sequence[str] = (),
    source: str = "",
    standby: Sequence[str] = (),
    below: Mapping[str, object] | None = None,
    external: str | None = None,
    pushes: Sequence[str] = (),
    quiet: bool = False,
) -> RunPlan:
    """Return the plan of a run; later layers win: profile, scenario, params, ``everywhere``, settings.

    ``scenario``: a shipped name or a parameter file's path, or its parameters, whose source names it.
    ``everywhere``: values for all nodes that declare them (``duration``, ``update_rate``).
    ``settings``: single values, as ``NODE.PARAM=VALUE`` or as a layer of one section.
    ``namespace``: of all nodes, empty or "/name"; relative node names in the files belong to it.
    ``swaps``: who takes over when; they set every controller's ``active.times``.
    ``below``: values for all nodes that declare them, where nothing else sets them.
    ``standby``: controllers that are started too, and act once they are configured and activated.
    ``external``: instead of a controller of ours, an external node gives the commands; the run goes by
    this name, or, if empty, by the node's own.
    ``pushes``: pulses on top of the disturbances, as `timeline.parse_push` reads them.
    ``quiet``: the disturbance stays in the plan even if it does nothing, for those who change its values.
    ``others``: nodes that ``settings`` may name besides those of this run. ``source``: what messages put
    before the names of ``everywhere``, such as the dashes of options.
    Raises PlanError, ParameterFileError or ParameterError, each one line that says what to do.
    """
    if controller not in CONTROLLERS:
        raise PlanError(
            f"no controller {controller!r}: give one of {', '.join(CONTROLLERS)}"
            f"{did_you_mean(controller, CONTROLLERS) or '; build and source your own package first'}"
        )
    turns = turns_of(controller, swaps) if external is None else {}
    standby = [name for name in dict.fromkeys(standby) if name not in turns]
    layers = [Layer("defaults", (Section("/**", dict(below or {})),)), *scenario_layers(scenario)]
    files = [read(find_file(name)) for name in params]
    layers += files
    layers += [
        Layer(f"{source}{_GIVEN_AS.get(name, name)}", (Section("/**", {name: value}),))
        for name, value in (everywhere or {}).items()
    ]
    single = [
        setting if isinstance(setting, Layer) else parse_setting(setting) for setting in settings
    ]
    layers += single
    plant = plant_of([layer.within(namespace) for layer in layers], namespace)
    layers = [Layer("the plant", (Section("/**", {PLANT_NAME: plant.name}),)), *layers]
    check_names(layers, declared_names(plant.name))
    layers += [Layer("standby", (Section(name, {"autostart": False}),)) for name in standby]
    reference = () if external is None else ("reference",)
    taking = ("simulator", *turns, *standby, "disturbance", *reference, "recorder")
    check_targets(single, (*taking, *others))
    warnings = [*not_taken([file.within(namespace) for file in files], taking, namespace)]
    layers = [layer.within(namespace) for layer in layers]
    # A path's stem need be no text.
    name = scenario.source if isinstance(scenario, Layer) else printable(Path(scenario).stem)
    resolved = {node: config_from(node, layers, namespace) for node in taking}
    simulator = resolved["simulator"].config
    # It publishes one plant step ahead: at another rate, its last message would not be for any step.
    disturbance = with_values(resolved["disturbance"].config, update_rate=simulator.update_rate)
    if set(disturbance.joints) == set(simulator.joints):  # the simulator takes one order
        disturbance = with_values(disturbance, joints=simulator.joints)
    end = simulator.duration or inf
    if pushes:
        disturbance = with_pushes(disturbance, pushes, end)
    warnings += [
        f"--swap-at {swap.time:g}:{swap.controller}: the run ends at {end:g} s, before that"
        for swap in swaps
        if swap.time > end
    ]
    lockstep = simulator.lockstep
    profile = None
    if external is not None and resolved["reference"].config.reference_profile != "topic":
        rate = simulator.update_rate
        profile = with_values(resolved["reference"].config, update_rate=rate, lockstep=lockstep)
    participants = (
        "effort_command",
        *(["disturbance"] if disturbance.active else []),
        *(["reference"] if profile is not None else []),
    )
    controllers = {
        node: with_values(
            resolved[node].config,
            lockstep=lockstep,
            **({"active_times": times} if swaps else {}),
        )
        for node, times in {**turns, **dict.fromkeys(standby, ())}.items()
    }
    plan = _checked(
        RunPlan(
            scenario=name,
            simulator=with_values(
                simulator,
                wait_for=(*participants, "recorder"),
                controllers=tuple(node for node, c in controllers.items() if c.active_times),
            ),
            controllers=controllers,
            disturbance=disturbance if disturbance.active else None,
            recorder=with_values(
                resolved["recorder"].config,
                controllers=tuple(controllers) or ((external,) if external else ()),
                scenario=name,
                lockstep=lockstep,
                lockstep_topics=("ground_truth/joint_states", "joint_states", *participants),
            ),
            namespace=namespace,
            warnings=tuple(warnings),
            external=external,
            reference=profile,
            qos_overrides={node: qos_overrides(f"{namespace}/{node}", layers) for node in taking},
        ),
        {node: configuration.with_units for node, configuration in resolved.items()},
        standby,
    )
    return with_values(plan, disturbance=disturbance) if quiet else plan


def check_rates(plan: RunPlan) -> None:
    """Raise PlanError for a controller whose period is not a whole number of the simulator's steps."""
    plant = plan.simulator.update_rate
    for name, controller in plan.controllers.items():
        control = controller.update_rate
        if control > plant * (1.0 + 1e-9):
            raise PlanError(
                f"{name}: update_rate {control:g} Hz is above the simulator's {plant:g} Hz: "
                "a controller cannot update more often than states arrive"
            )
        ratio = plant / control
        if abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise PlanError(
                f"{name}: update_rate {control:g} Hz is not an integer divisor of the "
                f"simulator's {plant:g} Hz: its period would not be a whole number of steps"
            )


def _checked(
    plan: RunPlan, with_units: Mapping[str, Collection[str]], standby: Collection[str]
) -> RunPlan:
    check_rates(plan)
    check_joints(plan)
    check_turns(plan, standby)
    return with_values(
        plan, warnings=(*plan.warnings, *advice(plan), *suspicious_units(plan.configs, with_units))
    )


def check_joints(plan: RunPlan) -> None:
    """Raise PlanError if a node's joint is not the one held, or another not one of the simulator's.

    And for a law with a model of another plant.
    """
    joints, plant = plan.simulator.joints, plan.simulator.kind.name
    for name in plan.controllers:
        if why := why_not_with(plant, name):
            raise PlanError(why)
    named = f"the simulator's joints: {', '.join(joints)}"
    if plan.disturbance is not None and set(plan.disturbance.joints) != set(joints):
        others = ", ".join(plan.disturbance.joints)
        raise PlanError(f"disturbance: joints {others} are not {named}: set disturbance.joints too")
    for name, controller in plan.controllers.items():
        if controller.hip is not None and controller.hip not in joints:
            raise PlanError(f"{name}: hip_joint {controller.hip!r} is not one of {named}")
    reference = {} if plan.reference is None else {"reference": plan.reference}
    for name, config in {**plan.controllers, **reference}.items():
        if config.joint != joints[1]:
            raise PlanError(f"{name}: joint {config.joint!r} is not the second of {named}")


def check_turns(plan: RunPlan, standby: Collection[str] = ()) -> None:
    """Raise PlanError unless exactly one controller acts at each time of the run, those on standby aside."""
    if plan.external is not None:
        return
    end = plan.simulator.duration or inf
    turns = {n: c.active_times_ns for n, c in plan.controllers.items() if n not in standby}
    for time_ns in sorted({0, *(t for times in turns.values() for t in times)}):
        acting = [name for name, times in turns.items() if active_at(times, time_ns)]
        if len(acting) != 1 and seconds(time_ns) <= end:
            raise PlanError(
                f"active.times: {' and '.join(acting) or 'no controller'} would act at "
                f"t = {seconds(time_ns):g} s: exactly one must act at any time"
            )


def does_not_hold(name: str, plant: Plant) -> str:
    """Return the warning of a controller that leaves a plant's first coordinate alone."""
    return f"{name} does not hold the {plant.coordinates[0].joint}, which may go anywhere"


def advice(plan: RunPlan) -> Iterable[str]:
    """Yield a warning if the derivative gain is close to the sampled loop's bound, or above it.

    And for each law that does not hold another plant's first coordinate, which the trunk's path carries.

    ``Kd b h < 2`` with ``b = d theta''/d u`` at rest, for the trunk ``(M + m) / (m l^2 M)``: one sample's
    effort must not overcorrect the rate that it damps.
    """
    kind = plan.simulator.kind
    if kind.name != TRUNK:
        yield from (
            does_not_hold(name, kind) for name, c in plan.controllers.items() if c.hip is None
        )
    gain = plan.simulator.input_gain
    if not gain > 0.0:
        return
    unit = plan.simulator.kind.driven.effort_unit
    for controller in plan.controllers.values():
        kd = controller.damping_gain
        period = seconds(controller.period_ns)
        bound = 2.0 / (gain * period)
        near = kd / bound
        if near >= 0.5 - 1e-9:
            state = (
                "at least half" if near < 1.0 - 1e-9 else "at" if near < 1.0 + 1e-9 else "beyond"
            )
            yield (
                f"kd = {kd:g} {unit} s/rad is {state} the bound {bound:g} of the sampled loop at "
                f"{1.0 / period:g} Hz: results depend on the rate"
                + ("; the loop is unstable" if near >= 1.0 - 1e-9 else "")
            )
