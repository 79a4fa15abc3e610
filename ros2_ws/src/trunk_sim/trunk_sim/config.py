"""Every parameter of the simulator, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi
from typing import Any

from trunk_msgs_util.elementary import LARGEST_ANGLE
from trunk_msgs_util.mechanics import Body
from trunk_msgs_util.parameters.body import body_of, body_parameter
from trunk_msgs_util.parameters.config import ManagedConfig
from trunk_msgs_util.parameters.declarations import ParameterError, parameter
from trunk_msgs_util.units import nanoseconds, period_ns, seconds

from .actuator import Actuator, approach_of
from .hardware_parameters import hardware_parameter, link_parameter
from .links import MOST_LATE, Link, most_late, perfect
from .operator_input import OperatorLimits
from .plant import PlantState
from .step import Plant, Scale, SensorParameters
from .traffic import Network

_JOINTS = ("hip", "trunk")
EQUATIONS = ("derived", "as_printed")


def joints_parameter() -> tuple[str, ...]:
    """Return the declaration of the joints' names, which the plant's nodes share."""
    joints: tuple[str, ...] = parameter(
        "joints", _JOINTS, "Names of the hip's and the trunk's joint", length=2, fixed=True
    )
    return joints


def update_rate_parameter() -> float:
    """Return the declaration of the plant's rate, which the plant's nodes share."""
    rate: float = parameter(
        "update_rate",
        200.0,
        "Rate of the plant's steps; the period is 1/rate, rounded to whole ns",
        unit="Hz",
        minimum=0.001,
        maximum=1e6,
        fixed=True,
    )
    return rate


@dataclass(frozen=True)
class SimulatorConfig(ManagedConfig):
    """Parameters of the ``simulator`` node."""

    update_rate: float = update_rate_parameter()
    substeps: int = parameter(
        "substeps", 1, "RK4 steps per period", minimum=1, maximum=10_000, fixed=True
    )
    duration: float = parameter(
        "duration",
        0.0,
        "Simulated time after which the run is finished and the node ends; 0: never",
        unit="s",
        minimum=0.0,
        maximum=1e6,
        fixed=True,
    )
    joints: tuple[str, ...] = joints_parameter()
    hip_mass: float = body_parameter("plant.hip_mass", "hip_mass")
    trunk_mass: float = body_parameter("plant.trunk_mass", "trunk_mass")
    length: float = body_parameter("plant.length", "length")
    gravity: float = body_parameter("plant.gravity", "gravity")
    equations: str = parameter(
        "plant.equations",
        "derived",
        "derived from the paper's Lagrangian, or as_printed: its misprinted eq. 12, wrong physics",
        choices=EQUATIONS,
    )
    amplitude: float = body_parameter("path.amplitude", "amplitude")
    wavenumber: float = body_parameter("path.wavenumber", "wavenumber")
    cosines: tuple[float, ...] = body_parameter("path.cosines", "cosines")
    sines: tuple[float, ...] = body_parameter("path.sines", "sines")
    hip_mode: str = body_parameter("hip.mode", "hip_mode")
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
    actuator_time_constant: float = hardware_parameter("actuator.time_constant")
    actuator_rate_limit: float = hardware_parameter("actuator.rate_limit")
    actuator_dead_band: float = hardware_parameter("actuator.dead_band")
    actuator_resolution: float = hardware_parameter("actuator.resolution")
    actuator_bias: float = hardware_parameter("actuator.bias")
    coulomb_friction: float = hardware_parameter("actuator.coulomb_friction")
    viscous_friction: float = hardware_parameter("actuator.viscous_friction")
    command_timeout: float = parameter(
        "command_timeout",
        0.2,
        "Real time: no command that answers a state older than this is used (zero torque), "
        "no disturbance older than this acts",
        unit="s",
        above=0.0,
        maximum=1e6,
    )
    position_noise: float = hardware_parameter("sensor.position_noise")
    velocity_noise: float = hardware_parameter("sensor.velocity_noise")
    position_bias: float = hardware_parameter("sensor.position_bias")
    velocity_bias: float = hardware_parameter("sensor.velocity_bias")
    position_resolution: float = hardware_parameter("sensor.position_resolution")
    velocity_resolution: float = hardware_parameter("sensor.velocity_resolution")
    position_limit: float = hardware_parameter("sensor.position_limit")
    velocity_limit: float = hardware_parameter("sensor.velocity_limit")
    delay: float = hardware_parameter("sensor.delay")
    seed: int = hardware_parameter("sensor.seed")
    dropout: float = hardware_parameter("sensor.dropout")
    state_delay: float = link_parameter("state", "delay")
    state_jitter: float = link_parameter("state", "jitter")
    state_jitter_kind: str = link_parameter("state", "jitter_kind")
    state_loss: float = link_parameter("state", "loss")
    state_burst_begin: float = link_parameter("state", "burst.begin")
    state_burst_end: float = link_parameter("state", "burst.end")
    state_burst_loss: float = link_parameter("state", "burst.loss")
    state_duplicates: float = link_parameter("state", "duplicates")
    state_order: str = link_parameter("state", "order")
    command_delay: float = link_parameter("command", "delay")
    command_jitter: float = link_parameter("command", "jitter")
    command_jitter_kind: str = link_parameter("command", "jitter_kind")
    command_loss: float = link_parameter("command", "loss")
    command_burst_begin: float = link_parameter("command", "burst.begin")
    command_burst_end: float = link_parameter("command", "burst.end")
    command_burst_loss: float = link_parameter("command", "burst.loss")
    command_duplicates: float = link_parameter("command", "duplicates")
    command_order: str = link_parameter("command", "order")
    missing_command: str = hardware_parameter("link.command.missing")
    link_seed: int = hardware_parameter("link.seed")
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
    lockstep: bool = parameter(
        "lockstep.enabled",
        False,
        "Step when all in wait_for, with effort_command, have answered the state, not by the wall clock",
        fixed=True,
    )
    lockstep_timeout: float = parameter(
        "lockstep.timeout",
        5.0,
        "A participant silent for this long ends the run",
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
    operator_force: float = hardware_parameter("operator.force")
    operator_torque: float = hardware_parameter("operator.torque")
    operator_timeout: float = hardware_parameter("operator.timeout")
    publish_clock: bool = parameter(
        "publish_clock", False, "Publish simulated time on /clock", fixed=True
    )

    def __post_init__(self) -> None:
        if self.lockstep and "effort_command" not in self.wait_for:
            needed = "effort_command among them, as lockstep.enabled is true"
            raise ParameterError("wait_for", self.wait_for, needed)
        x, theta = self.initial_position
        if max(abs(x * self.wavenumber), abs(theta)) > LARGEST_ANGLE:
            raise ParameterError(
                "initial.position",
                self.initial_position,
                f"at most {LARGEST_ANGLE:g} rad, for the trunk's angle and for path.wavenumber times x",
            )
        path = self.amplitude, self.wavenumber, self.body.harmonics
        printed = (path, self.hip_mode) == ((1.0, 1.0, None), "passive")
        if self.equations == "as_printed" and not printed:
            raise ParameterError(
                "plant.equations",
                self.equations,
                "derived, where path.amplitude or path.wavenumber is not 1, path.cosines or path.sines "
                "not empty or hip.mode not passive: the paper prints no other case",
            )

        for link in ("state", "command"):
            late = most_late(_link_of(self, link), self.period_ns)
            if late > MOST_LATE:
                raise ParameterError(
                    f"link.{link}.jitter",
                    getattr(self, f"{link}_jitter"),
                    f"at most {MOST_LATE} steps late with the delay at this update_rate, not {late}",
                )

    @property
    def period_ns(self) -> int:
        """The control period h in ns."""
        return period_ns(self.update_rate)

    @property
    def body(self) -> Body:
        """The constants of hip, trunk and path."""
        return body_of(self, self.equations == "as_printed")

    @property
    def plant(self) -> Plant:
        """What `act` takes besides the trunk, the effort and the disturbance."""
        return Plant(
            self.body,
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
