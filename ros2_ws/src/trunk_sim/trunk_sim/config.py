"""Every parameter of the simulator, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import inf, pi
from typing import Any, ClassVar

from trunk_core.elementary import LARGEST_ANGLE
from trunk_core.parameters.declarations import ParameterError, parameter
from trunk_core.parameters.shared import lockstep_parameter
from trunk_core.units import nanoseconds, seconds

from .inputs import OperatorLimits
from .links import MOST_LATE, Link, Network, most_late, perfect
from .plant import Plant, PlantConfig, PlantState, config_for
from .plants.trunk import PLANT, TrunkConfig
from .step import (
    Actuator,
    Dynamics,
    PlantConstants,
    Scale,
    SensorParameters,
    approach_of,
    on_first,
    on_second,
)

_TORQUE: dict[str, Any] = {"unit": "N m", "minimum": 0.0, "maximum": 1e6}
_ANGLE: dict[str, Any] = {"unit": "rad", "minimum": 0.0, "maximum": 1e3}
_RATE: dict[str, Any] = {"unit": "rad/s", "minimum": 0.0, "maximum": 1e3}
_EITHER_WAY: dict[str, Any] = {"minimum": -1e3, "maximum": 1e3}
_LIMIT: dict[str, Any] = {"above": 0.0, "unbounded": True}
_SEED: dict[str, Any] = {"minimum": 0, "maximum": 2**31 - 1, "fixed": True}
_CHANCE: dict[str, Any] = {"minimum": 0.0, "maximum": 1.0, "fixed": True}
_DELAY: dict[str, Any] = {"unit": "s", "minimum": 0.0, "maximum": 10.0, "fixed": True}
# Of a link, by the last part of the name.
_LINK: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "delay": (
        0.0,
        "Delay of every message; it is used from the first step at or after its arrival",
        _DELAY,
    ),
    "jitter": (0.0, "Random additional delay: the largest, or the mean if exponential", _DELAY),
    "jitter_kind": (
        "uniform",
        "Distribution of the jitter",
        {"choices": ("uniform", "exponential"), "fixed": True},
    ),
    "loss": (0.0, "Probability that a message is lost, outside of bursts", _CHANCE),
    "burst.begin": (0.0, "Probability in each step that a burst of losses begins", _CHANCE),
    "burst.end": (1.0, "Probability in each step of a burst that it ends", _CHANCE),
    "burst.loss": (1.0, "Probability that a message is lost in a burst", _CHANCE),
    "duplicates": (0.0, "Probability that a message is sent twice", _CHANCE),
    "order": (
        "latest",
        "latest: a message older than the one in use is ignored; arrival: the last to arrive counts",
        {"choices": ("latest", "arrival"), "fixed": True},
    ),
}


def _link_parameter(link: str, name: str) -> Any:
    """Return the declaration of a link's parameter: of "state", to the controller, or "command"."""
    default, description, limits = _LINK[name]
    to = "measured states" if link == "state" else "commands"
    return parameter(f"link.{link}.{name}", default, f"{description} (link of the {to})", **limits)


@dataclass(frozen=True)
class SimulatorConfig(PlantConfig):
    """Parameters of the ``simulator`` node that all plants have: a plant's own come before them."""

    initial_position: tuple[float, ...] = parameter(
        "initial.position",
        (0.0, pi / 6.0),
        "Initial x of the hip and angle of the trunk",
        unit="m, rad",
        length=2,
        minimum=-1e6,
        maximum=1e6,
    )
    initial_velocity: tuple[float, ...] = parameter(
        "initial.velocity",
        (1.0, 0.0),
        "Initial velocities of the hip and of the trunk",
        unit="m/s, rad/s",
        length=2,
        minimum=-1e6,
        maximum=1e6,
    )
    max_effort: float = parameter(
        "max_effort",
        inf,
        "The actuator's limit: commands are clamped to +- this",
        unit="N m",
        above=0.0,
        unbounded=True,
    )
    actuator_time_constant: float = parameter(
        "actuator.time_constant",
        0.0,
        "Time constant of the actuator's lag; 0: none",
        unit="s",
        minimum=0.0,
        maximum=1e3,
    )
    actuator_rate_limit: float = parameter(
        "actuator.rate_limit", inf, "Largest rate of change of its torque", unit="N m/s", **_LIMIT
    )
    actuator_dead_band: float = parameter(
        "actuator.dead_band",
        0.0,
        "Commands within +- this give no torque, larger ones are reduced by it",
        **_TORQUE,
    )
    actuator_resolution: float = parameter(
        "actuator.resolution",
        0.0,
        "Its torque is a multiple of this, before bias and lag; 0: continuous",
        **_TORQUE,
    )
    actuator_bias: float = parameter(
        "actuator.bias", 0.0, "Torque added to it", unit="N m", minimum=-1e6, maximum=1e6
    )
    coulomb_friction: float = parameter(
        "actuator.coulomb_friction",
        0.0,
        "Coulomb friction in the joint, against any motion",
        **_TORQUE,
    )
    viscous_friction: float = parameter(
        "actuator.viscous_friction",
        0.0,
        "Viscous friction in the joint, proportional to its rate",
        unit="N m s/rad",
        minimum=0.0,
        maximum=1e6,
    )
    command_timeout: float = parameter(
        "command_timeout",
        0.2,
        "Real time: no command that answers a state older than this is used (zero torque), "
        "no disturbance older than this acts",
        unit="s",
        above=0.0,
        maximum=1e6,
    )
    position_noise: float = parameter(
        "sensor.position_noise", 0.0, "Standard deviation of the measured angle", **_ANGLE
    )
    velocity_noise: float = parameter(
        "sensor.velocity_noise", 0.0, "Standard deviation of the measured rate", **_RATE
    )
    position_bias: float = parameter(
        "sensor.position_bias", 0.0, "Bias of the measured angle", unit="rad", **_EITHER_WAY
    )
    velocity_bias: float = parameter(
        "sensor.velocity_bias", 0.0, "Bias of the measured rate", unit="rad/s", **_EITHER_WAY
    )
    position_resolution: float = parameter(
        "sensor.position_resolution",
        0.0,
        "The measured angle is a multiple of this; 0: continuous",
        **_ANGLE,
    )
    velocity_resolution: float = parameter(
        "sensor.velocity_resolution",
        0.0,
        "The measured rate is a multiple of this; 0: continuous",
        **_RATE,
    )
    position_limit: float = parameter(
        "sensor.position_limit",
        inf,
        "The largest angle that is measured, either way",
        unit="rad",
        **_LIMIT,
    )
    velocity_limit: float = parameter(
        "sensor.velocity_limit",
        inf,
        "The largest rate that is measured, either way",
        unit="rad/s",
        **_LIMIT,
    )
    delay: float = parameter(
        "sensor.delay",
        0.0,
        "Delay of the measurements, rounded to whole periods",
        **_DELAY,
    )
    seed: int = parameter("sensor.seed", 1, "Seed of the sensor noise", **_SEED)
    dropout: float = parameter(
        "sensor.dropout",
        0.0,
        "Probability that a measurement fails; the previous one is then held",
        **_CHANCE,
    )
    state_delay: float = _link_parameter("state", "delay")
    state_jitter: float = _link_parameter("state", "jitter")
    state_jitter_kind: str = _link_parameter("state", "jitter_kind")
    state_loss: float = _link_parameter("state", "loss")
    state_burst_begin: float = _link_parameter("state", "burst.begin")
    state_burst_end: float = _link_parameter("state", "burst.end")
    state_burst_loss: float = _link_parameter("state", "burst.loss")
    state_duplicates: float = _link_parameter("state", "duplicates")
    state_order: str = _link_parameter("state", "order")
    command_delay: float = _link_parameter("command", "delay")
    command_jitter: float = _link_parameter("command", "jitter")
    command_jitter_kind: str = _link_parameter("command", "jitter_kind")
    command_loss: float = _link_parameter("command", "loss")
    command_burst_begin: float = _link_parameter("command", "burst.begin")
    command_burst_end: float = _link_parameter("command", "burst.end")
    command_burst_loss: float = _link_parameter("command", "burst.loss")
    command_duplicates: float = _link_parameter("command", "duplicates")
    command_order: str = _link_parameter("command", "order")
    missing_command: str = parameter(
        "link.command.missing",
        "hold",
        "A step that gets no new command: hold the last one's torque, or zero",
        choices=("hold", "zero"),
        fixed=True,
    )
    link_seed: int = parameter(
        "link.seed", 1, "Seed of the links and of failing measurements", **_SEED
    )
    wait_for: tuple[str, ...] = parameter(
        "wait_for",
        ("effort_command",),
        "Hold the first state until these topics are matched; empty: start at once",
        element=str,
        choices=("effort_command", "disturbance", "reference", "recorder"),
        fixed=True,
    )
    controllers: tuple[str, ...] = parameter(
        "controllers",
        (),
        "Controllers that take turns, all ready before the first state; empty: one, of any name",
        element=str,
        fixed=True,
    )
    fall_angle: float = parameter(
        "fall.angle",
        pi / 2.0,
        "Beyond this angle, either way, the trunk has fallen, and the run is marked as such",
        unit="rad",
        above=0.0,
        unbounded=True,
    )
    fall_stop: bool = parameter(
        "fall.stop", False, "Finish the run when the trunk has fallen", fixed=True
    )
    lockstep: bool = lockstep_parameter(
        "Step when all in wait_for, with effort_command, have answered the state, not by the wall clock"
    )
    lockstep_timeout: float = parameter(
        "lockstep.timeout",
        30.0,
        "A participant silent for this long, times TRUNK_PATIENCE, ends the run",
        unit="s",
        above=0.0,
        maximum=3600.0,
        fixed=True,
    )
    lockstep_speed: float = parameter(
        "lockstep.speed",
        0.0,
        "Pace, as a multiple of real time; 0: as fast as the machine allows",
        minimum=0.0,
        maximum=1e6,
    )
    lockstep_window: int = parameter(
        "lockstep.window",
        500,
        "Steps by which the recorder may lag before the plant waits for it",
        minimum=1,
        maximum=4000,
        fixed=True,
    )
    operator_force: float = parameter(
        "operator.force",
        0.0,
        "Largest force of an operator on the hip, either way; nobody may push if this and the torque are 0",
        unit="N",
        minimum=0.0,
        maximum=1e6,
        fixed=True,
    )
    operator_torque: float = parameter(
        "operator.torque",
        0.0,
        "Largest torque of an operator on the trunk, either way",
        **_TORQUE,
        fixed=True,
    )
    operator_timeout: float = parameter(
        "operator.timeout",
        0.25,
        "A push ends when nothing has come from the operator for this long",
        unit="s",
        above=0.0,
        maximum=60.0,
        fixed=True,
    )
    publish_clock: bool = parameter(
        "publish_clock", False, "Publish simulated time on /clock", fixed=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lockstep and "effort_command" not in self.wait_for:
            needed = "effort_command among them, as lockstep.enabled is true"
            raise ParameterError("wait_for", self.wait_for, needed)
        if self.joints[0] == self.joints[1]:
            needed = self.kind.words("two names, the hip's and the trunk's")
            raise ParameterError("joints", self.joints, needed)
        if self.kind.largest_angle(self.initial_state, self.constants) > LARGEST_ANGLE:
            raise ParameterError(
                "initial.position",
                self.initial_position,
                f"at most {LARGEST_ANGLE:g} rad, for every angle, the phase on a path among them",
            )
        for link in ("state", "command"):
            whole = _link_of(self, link)
            for field, part in (("delay", whole._replace(jitter=0.0)), ("jitter", whole)):
                late = most_late(part, self.period_ns)
                if late > MOST_LATE:
                    added = " with the delay" if field == "jitter" else ""
                    raise ParameterError(
                        f"link.{link}.{field}",
                        getattr(whole, field),
                        f"at most {MOST_LATE} steps late{added} at this update_rate, not {late}",
                    )

    @property
    def dynamics(self) -> Dynamics:
        """The functions that move the plant."""
        return Dynamics((on_first, on_second)[self.kind.drive], self.accelerations)

    @property
    def input_gain(self) -> float:
        """``d theta'' / d u`` at rest on level ground, rad/s^2 per N or N m of the command u."""
        kind, constants = self.kind, self.kind.level(self.constants)
        moves = kind.held if self.accelerations is kind.held else kind.accelerations
        forces = (1.0, 0.0) if kind.drive == 0 else (0.0, 1.0)
        pushed, free = (moves(kind.rest, *given, constants)[1] for given in (forces, (0.0, 0.0)))
        return pushed - free

    @property
    def plant(self) -> PlantConstants:
        """What `act` takes besides the trunk, the effort and the disturbance."""
        return PlantConstants(
            self.constants,
            seconds(self.period_ns),
            self.substeps,
            self.max_effort,
            self.fall_angle,
            self.actuator,
        )

    @property
    def operator_limits(self) -> OperatorLimits | None:
        """What an operator may do; None if nothing."""
        if not (self.operator_force or self.operator_torque):
            return None
        timeout_ns = nanoseconds(self.operator_timeout)
        return OperatorLimits(self.operator_force, self.operator_torque, timeout_ns)

    @property
    def actuator(self) -> Actuator | None:
        """The actuator's constants for a period; None if they change nothing."""
        period = seconds(self.period_ns)
        actuator = Actuator(
            approach_of(self.actuator_time_constant, period),
            self.actuator_rate_limit * period,
            self.actuator_dead_band,
            self.actuator_resolution,
            self.actuator_bias,
            self.coulomb_friction,
            self.viscous_friction,
        )
        return None if actuator == Actuator() else actuator

    @property
    def initial_state(self) -> PlantState:
        """The state at t = 0."""
        (x, theta), (x_dot, theta_dot) = self.initial_position, self.initial_velocity
        return PlantState(x, theta, x_dot, theta_dot)

    @property
    def sensor(self) -> SensorParameters:
        """The sensors' constants."""
        scale = Scale(
            self.position_resolution,
            self.velocity_resolution,
            self.position_limit,
            self.velocity_limit,
        )
        return SensorParameters(
            self.position_noise,
            self.velocity_noise,
            self.position_bias,
            self.velocity_bias,
            None if scale == Scale() else scale,
        )

    @property
    def delay_steps(self) -> int:
        """The sensors' delay in whole steps."""
        return round(nanoseconds(self.delay) / self.period_ns)

    @property
    def network(self) -> Network | None:
        """The links between plant and controller, and failing measurements; None if they change nothing."""
        state, command = _link_of(self, "state"), _link_of(self, "command")
        if all(map(perfect, (state, command))) and self.dropout == 0.0:
            return None
        zero = self.missing_command == "zero"
        return Network(state, command, zero, self.dropout, self.link_seed, self.period_ns)


@dataclass(frozen=True)
class TrunkSimulator(SimulatorConfig, TrunkConfig):
    """Parameters of the ``simulator`` node with the trunk."""

    kind: ClassVar[Plant] = PLANT


simulator_class = partial(config_for, TrunkSimulator, SimulatorConfig)


def _link_of(config: SimulatorConfig, link: str) -> Link:
    """Return the link whose fields begin with "state" or "command"."""

    def value(name: str) -> Any:
        return getattr(config, f"{link}_{name}")

    return Link(
        value("delay"),
        value("jitter"),
        value("jitter_kind") == "exponential",
        value("loss"),
        value("burst_begin"),
        value("burst_end"),
        value("burst_loss"),
        value("duplicates"),
        value("order") == "latest",
    )
