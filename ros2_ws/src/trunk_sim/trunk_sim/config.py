"""Every parameter of the simulator and of the disturbance node, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

from trunk_msgs_util.declarations import ParameterError, parameter
from trunk_msgs_util.units import nanoseconds, period_ns

from .disturbances import CHANNELS, Signals, noise_components
from .plant import PlantParameters, PlantState
from .sensors import SensorParameters

_JOINTS = ("hip", "trunk")
EQUATIONS = ("derived", "as_printed")


def _joints() -> tuple[str, ...]:
    joints: tuple[str, ...] = parameter(
        "joints", _JOINTS, "Names of the hip's and the trunk's joint", length=2, fixed=True
    )
    return joints


def _update_rate() -> float:
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
class SimulatorConfig:
    """Parameters of the ``simulator`` node."""

    update_rate: float = _update_rate()
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
    joints: tuple[str, ...] = _joints()
    hip_mass: float = parameter(
        "plant.hip_mass", 2.0, "Mass M of the hip", unit="kg", above=0.0, maximum=1e6
    )
    trunk_mass: float = parameter(
        "plant.trunk_mass", 0.5, "Mass m of the trunk", unit="kg", above=0.0, maximum=1e6
    )
    length: float = parameter(
        "plant.length",
        1.0,
        "Distance l from hip to centre of mass",
        unit="m",
        above=0.0,
        maximum=1e3,
    )
    gravity: float = parameter(
        "plant.gravity", 9.81, "Gravity g", unit="m/s^2", minimum=0.0, maximum=1e3
    )
    equations: str = parameter(
        "plant.equations",
        "derived",
        "derived from the paper's Lagrangian, or as_printed: its misprinted eq. 12, wrong physics",
        choices=EQUATIONS,
    )
    amplitude: float = parameter(
        "path.amplitude",
        1.0,
        "Amplitude A of the path A sin(kx)",
        unit="m",
        minimum=-1e3,
        maximum=1e3,
    )
    wavenumber: float = parameter(
        "path.wavenumber", 1.0, "Wave number k of the path", unit="rad/m", minimum=0.0, maximum=1e3
    )
    hip_mode: str = parameter(
        "hip.mode",
        "passive",
        "passive: the hip rolls freely on its path; prescribed: it keeps its horizontal speed",
        choices=("passive", "prescribed"),
    )
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
    command_timeout: float = parameter(
        "command_timeout",
        0.2,
        "Real time: a command that answers a state older than this is not used (zero torque)",
        unit="s",
        above=0.0,
        maximum=1e6,
    )
    position_noise: float = parameter(
        "sensor.position_noise",
        0.0,
        "Standard deviation of the measured angle",
        unit="rad",
        minimum=0.0,
        maximum=1e3,
    )
    velocity_noise: float = parameter(
        "sensor.velocity_noise",
        0.0,
        "Standard deviation of the measured rate",
        unit="rad/s",
        minimum=0.0,
        maximum=1e3,
    )
    position_bias: float = parameter(
        "sensor.position_bias",
        0.0,
        "Bias of the measured angle",
        unit="rad",
        minimum=-1e3,
        maximum=1e3,
    )
    velocity_bias: float = parameter(
        "sensor.velocity_bias",
        0.0,
        "Bias of the measured rate",
        unit="rad/s",
        minimum=-1e3,
        maximum=1e3,
    )
    delay: float = parameter(
        "sensor.delay",
        0.0,
        "Delay of the measurements, rounded to whole periods",
        unit="s",
        minimum=0.0,
        maximum=10.0,
        fixed=True,
    )
    seed: int = parameter(
        "sensor.seed", 1, "Seed of the sensor noise", minimum=0, maximum=2**31 - 1, fixed=True
    )
    wait_for: tuple[str, ...] = parameter(
        "wait_for",
        ("effort_command",),
        "Hold the first state until these topics are matched; an empty list starts at once",
        element=str,
        choices=("effort_command", "disturbance", "recorder"),
        fixed=True,
    )
    lockstep: bool = parameter(
        "lockstep.enabled",
        False,
        "Step when every topic in wait_for has answered the state, not by the wall clock",
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
        fixed=True,
    )
    lockstep_window: int = parameter(
        "lockstep.window",
        500,
        "Steps that the recorder may be behind before the plant waits for it",
        minimum=1,
        maximum=4000,
        fixed=True,
    )
    publish_clock: bool = parameter(
        "publish_clock", False, "Publish simulated time on /clock", fixed=True
    )

    def __post_init__(self) -> None:
        printed = (self.amplitude, self.wavenumber, self.hip_mode) == (1.0, 1.0, "passive")
        if self.equations == "as_printed" and not printed:
            raise ParameterError(
                "plant.equations",
                self.equations,
                "derived, where path.amplitude or path.wavenumber is not 1 or hip.mode not passive: "
                "the paper prints no other case",
            )

    @property
    def period_ns(self) -> int:
        """The control period h in ns."""
        return period_ns(self.update_rate)

    @property
    def plant(self) -> PlantParameters:
        """The plant's constants."""
        return PlantParameters(
            self.hip_mass,
            self.trunk_mass,
            self.length,
            self.gravity,
            self.amplitude,
            self.wavenumber,
            self.hip_mode == "prescribed",
            self.equations == "as_printed",
        )

    @property
    def initial_state(self) -> PlantState:
        """The state at t = 0."""
        (x, theta), (x_dot, theta_dot) = self.initial_position, self.initial_velocity
        return PlantState(x, theta, x_dot, theta_dot)

    @property
    def sensor(self) -> SensorParameters:
        """The sensors' constants."""
        return SensorParameters(
            self.position_noise, self.velocity_noise, self.position_bias, self.velocity_bias
        )

    @property
    def delay_steps(self) -> int:
        """The sensors' delay in whole steps."""
        return round(nanoseconds(self.delay) / self.period_ns)


@dataclass(frozen=True)
class DisturbanceConfig:
    """Parameters of the ``disturbance`` node. Each signal acts on the channel that it names."""

    update_rate: float = _update_rate()
    joints: tuple[str, ...] = _joints()
    pulse_channel: str = parameter(
        "pulse.channel",
        "trunk_position",
        "What the pulses act on: a force, a torque, or an offset on a measurement",
        choices=CHANNELS,
    )
    pulse_start_times: tuple[float, ...] = parameter(
        "pulse.start_times",
        (),
        "When the pulses start",
        unit="s",
        element=float,
        minimum=0.0,
        maximum=1e6,
    )
    pulse_duration: float = parameter(
        "pulse.duration", 0.1, "How long each lasts", unit="s", minimum=0.0, maximum=1e6
    )
    pulse_magnitude: float = parameter(
        "pulse.magnitude",
        100.0 * pi / 180.0,
        "Their magnitude, in the channel's unit",
        unit="N, N m, m or rad",
        minimum=-1e9,
        maximum=1e9,
    )
    sine_channel: str = parameter(
        "sine.channel", "hip_effort", "What the sine acts on", choices=CHANNELS
    )
    sine_amplitude: float = parameter(
        "sine.amplitude", 0.0, "Its amplitude", unit="N, N m, m or rad", minimum=-1e9, maximum=1e9
    )
    sine_frequency: float = parameter(
        "sine.frequency", 1.0, "Its frequency", unit="Hz", minimum=0.0, maximum=1e5
    )
    sine_phase: float = parameter(
        "sine.phase", 0.0, "Its phase at t = 0", unit="rad", minimum=-1e3, maximum=1e3
    )
    noise_channel: str = parameter(
        "noise.channel", "trunk_effort", "What the noise acts on", choices=CHANNELS
    )
    noise_rms: float = parameter(
        "noise.rms", 0.0, "Its root mean square", unit="N, N m, m or rad", minimum=0.0, maximum=1e9
    )
    noise_low: float = parameter(
        "noise.low_frequency", 0.5, "Lower end of its band", unit="Hz", minimum=0.0, maximum=1e5
    )
    noise_high: float = parameter(
        "noise.high_frequency", 5.0, "Upper end of its band", unit="Hz", above=0.0, maximum=1e5
    )
    noise_components: int = parameter(
        "noise.components", 32, "Number of sines that make it up", minimum=1, maximum=4096
    )
    noise_seed: int = parameter(
        "noise.seed", 1, "Seed of their frequencies and phases", minimum=0, maximum=2**31 - 1
    )

    def __post_init__(self) -> None:
        if self.noise_high <= self.noise_low:
            raise ParameterError(
                "noise.high_frequency",
                self.noise_high,
                f"greater than noise.low_frequency ({self.noise_low:g})",
            )

    @property
    def period_ns(self) -> int:
        """The plant's period h in ns."""
        return period_ns(self.update_rate)

    @property
    def active(self) -> bool:
        """False where every signal is zero: the node need not run."""
        return bool(
            (self.pulse_start_times and self.pulse_magnitude and self.pulse_duration)
            or self.sine_amplitude
            or self.noise_rms
        )

    @property
    def signals(self) -> Signals:
        """The signals that `disturbance_at` evaluates."""
        amplitude, frequencies, phases = noise_components(
            self.noise_rms, self.noise_low, self.noise_high, self.noise_components, self.noise_seed
        )
        return Signals(
            CHANNELS.index(self.pulse_channel),
            tuple(nanoseconds(t) for t in self.pulse_start_times),
            nanoseconds(self.pulse_duration),
            self.pulse_magnitude,
            CHANNELS.index(self.sine_channel),
            self.sine_amplitude,
            self.sine_frequency,
            self.sine_phase,
            CHANNELS.index(self.noise_channel),
            amplitude,
            frequencies,
            phases,
        )
