"""Every parameter of the disturbance node, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import pi
from typing import Any, ClassVar

from trunk_core.parameters.declarations import (
    MOST_ROWS,
    ParameterError,
    TableFile,
    Value,
    check_rows,
    parameter,
    times_parameter,
)
from trunk_core.parameters.shared import PeriodicConfig
from trunk_core.units import nanoseconds

from .disturbances import CHANNELS, Signals, noise_components, random_starts
from .plant import Plant, config_for, joints_parameter
from .plants.trunk import PLANT

INTERPOLATIONS = ("linear", "hold")


def _magnitude(
    signal: str, name: str, default: Value, description: str, minimum: float, **more: Any
) -> Any:
    """Return the declaration of a signal's magnitude, in the unit of its channel."""
    return parameter(
        f"{signal}.{name}",
        default,
        description,
        unit="N, N m, m or rad",
        unit_by=f"{signal}.channel",
        units=tuple(PLANT.channel_units.items()),
        minimum=minimum,
        maximum=1e9,
        **more,
    )


@dataclass(frozen=True)
class DisturbanceConfig(PeriodicConfig):
    """Parameters of the ``disturbance`` node. Each signal acts on its own channel."""

    table_files: ClassVar[tuple[TableFile, ...]] = (TableFile("table", "value"),)
    kind: ClassVar[Plant] = PLANT

    joints: tuple[str, ...] = joints_parameter()
    pulse_channel: str = parameter(
        "pulse.channel",
        "trunk_position",
        "What the pulses act on: a force, a torque, or an offset on a measurement",
        choices=CHANNELS,
    )
    pulse_start_times: tuple[float, ...] = times_parameter(
        "pulse.start_times", "When the pulses start"
    )
    pulse_duration: float = parameter(
        "pulse.duration", 0.1, "How long each lasts", unit="s", minimum=0.0, maximum=1e6
    )
    pulse_magnitude: float = _magnitude(
        "pulse", "magnitude", 100.0 * pi / 180.0, "Their magnitude, in the channel's unit", -1e9
    )
    pulse_random_count: int = parameter(
        "pulse.random_count",
        0,
        "How many more pulses start at random times",
        minimum=0,
        maximum=10_000,
    )
    pulse_random_from: float = parameter(
        "pulse.random_from",
        0.0,
        "Earliest start of a random pulse",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    pulse_random_until: float = parameter(
        "pulse.random_until",
        10.0,
        "Latest start of a random pulse",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    pulse_random_seed: int = parameter(
        "pulse.random_seed", 1, "Seed of the random times", minimum=0, maximum=2**31 - 1
    )
    sine_channel: str = parameter(
        "sine.channel", "hip_effort", "What the sine acts on", choices=CHANNELS
    )
    sine_amplitude: float = _magnitude("sine", "amplitude", 0.0, "Its amplitude", -1e9)
    sine_frequency: float = parameter(
        "sine.frequency", 1.0, "Its frequency", unit="Hz", minimum=0.0, maximum=1e5
    )
    sine_phase: float = parameter(
        "sine.phase", 0.0, "Its phase at t = 0", unit="rad", minimum=-1e3, maximum=1e3
    )
    noise_channel: str = parameter(
        "noise.channel", "trunk_effort", "What the noise acts on", choices=CHANNELS
    )
    noise_rms: float = _magnitude("noise", "rms", 0.0, "Its root mean square", 0.0)
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
    table_channel: str = parameter(
        "table.channel", "trunk_effort", "What the table acts on", choices=CHANNELS
    )
    table_times: tuple[float, ...] = times_parameter("table.times", "Times of its rows, ascending")
    table_values: tuple[float, ...] = _magnitude(
        "table",
        "values",
        (),
        "Values of its rows; zero before the first row, the last value after the last",
        -1e9,
        element=float,
        longest=MOST_ROWS,
    )
    table_interpolation: str = parameter(
        "table.interpolation",
        "linear",
        "Between two rows: a straight line, or the earlier row's value",
        choices=INTERPOLATIONS,
    )

    def __post_init__(self) -> None:
        if self.pulse_random_count and self.pulse_random_until < self.pulse_random_from:
            raise ParameterError(
                "pulse.random_until",
                self.pulse_random_until,
                f"at least pulse.random_from ({self.pulse_random_from:g})",
            )
        check_rows("table", self.table_times, self.table_values)
        if self.noise_high <= self.noise_low:
            raise ParameterError(
                "noise.high_frequency",
                self.noise_high,
                f"it must be greater than noise.low_frequency ({self.noise_low:g})",
            )

    @property
    def active(self) -> bool:
        """False if every signal is zero: the node need not run."""
        pulses = self.pulse_start_times or self.pulse_random_count
        return bool(
            (pulses and self.pulse_magnitude and self.pulse_duration)
            or self.sine_amplitude
            or self.noise_rms
            or any(self.table_values)
        )

    @property
    def signals(self) -> Signals:
        """The signals that `disturbance_at` evaluates."""
        amplitude, frequencies, phases = noise_components(
            self.noise_rms, self.noise_low, self.noise_high, self.noise_components, self.noise_seed
        )
        random = random_starts(
            self.pulse_random_count,
            self.pulse_random_from,
            self.pulse_random_until,
            self.pulse_random_seed,
        )
        channels = self.kind.channels
        return Signals(
            channels.index(self.pulse_channel),
            tuple(nanoseconds(t) for t in (*self.pulse_start_times, *random)),
            nanoseconds(self.pulse_duration),
            self.pulse_magnitude,
            channels.index(self.sine_channel),
            self.sine_amplitude,
            self.sine_frequency,
            self.sine_phase,
            channels.index(self.noise_channel),
            amplitude,
            frequencies,
            phases,
            channels.index(self.table_channel),
            self.table_interpolation == "linear",
            tuple(nanoseconds(t) for t in self.table_times),
            self.table_values,
        )


disturbance_class = partial(config_for, DisturbanceConfig, DisturbanceConfig)
