"""What a run may have, by name, each as settings; LAW stands for the controller's name."""

from collections.abc import Mapping, Sequence

_FALLS = (
    "LAW.u_clamp_max=0.1",
    "LAW.u_clamp_min=-0.1",
    "simulator.initial.velocity=[1.0, 4.0]",
    "simulator.fall.angle=0.8",
)
_BURSTS = ("burst.begin=0.1", "burst.end=0.3", "burst.loss=0.9")
FEATURES: Mapping[str, Sequence[str]] = {
    "state delay": ["simulator.link.state.delay=12ms"],
    "command delay": ["simulator.link.command.delay=8ms"],
    "uniform jitter": ["simulator.link.state.jitter=15ms", "simulator.link.command.jitter=9ms"],
    "exponential jitter": [
        "simulator.link.state.jitter=6ms",
        "simulator.link.state.jitter_kind=exponential",
        "simulator.link.command.jitter=7ms",
        "simulator.link.command.jitter_kind=exponential",
        "simulator.link.state.order=arrival",
    ],
    "loss, hold": ["simulator.link.state.loss=0.2", "simulator.link.command.loss=0.3"],
    "loss, zero": ["simulator.link.command.loss=0.3", "simulator.link.command.missing=zero"],
    "bursts": [
        f"simulator.link.{link}.{burst}" for link in ("state", "command") for burst in _BURSTS
    ],
    "duplicates": [
        "simulator.link.state.duplicates=0.4",
        "simulator.link.state.jitter=10ms",
        "simulator.link.command.duplicates=0.3",
        "simulator.link.command.jitter=12ms",
        "simulator.link.command.order=arrival",
        "simulator.link.seed=5",
    ],
    "lag": ["simulator.actuator.time_constant=0.03"],
    "rate limit": ["simulator.actuator.rate_limit=300.0"],
    "dead band": ["simulator.actuator.dead_band=1.5", "simulator.actuator.bias=0.4"],
    "steps of torque": ["simulator.actuator.resolution=0.7"],
    "friction": [
        "simulator.actuator.coulomb_friction=0.6",
        "simulator.actuator.viscous_friction=0.3",
    ],
    "torque limit": ["simulator.max_effort=7.0", "LAW.antiwindup_strategy=back_calculation"],
    "noise": ["simulator.sensor.position_noise=0.002", "simulator.sensor.velocity_noise=0.03"],
    "sensor delay": ["simulator.sensor.delay=0.015", "simulator.sensor.position_noise=0.001"],
    "sensor bias": ["simulator.sensor.position_bias=0.03", "simulator.sensor.velocity_bias=-0.1"],
    "sensor resolution": [
        "simulator.sensor.position_resolution=0.01",
        "simulator.sensor.velocity_resolution=0.05",
    ],
    "sensor limits": ["simulator.sensor.position_limit=0.4", "simulator.sensor.velocity_limit=0.9"],
    "dropout": ["simulator.sensor.dropout=0.3", "simulator.sensor.velocity_noise=0.01"],
    "sine": [
        "disturbance.sine.amplitude=3.0",
        "disturbance.sine.frequency=7.0",
        "disturbance.sine.phase=0.4",
    ],
    "band of noise": ["disturbance.noise.rms=1.5", "disturbance.noise.components=5"],
    "table, lines": [
        "disturbance.table.times=[0.05, 0.1, 0.2]",
        "disturbance.table.values=[0.0, 2.0, -1.0]",
    ],
    "table, held": [
        "disturbance.table.times=[0.03, 0.08, 0.13]",
        "disturbance.table.values=[0.5, -0.2, 0.1]",
        "disturbance.table.channel=hip_position",
        "disturbance.table.interpolation=hold",
    ],
    "pulses": [
        "disturbance.pulse.start_times=[0.05, 0.12]",
        "disturbance.pulse.duration=0.03",
        "disturbance.pulse.magnitude=0.5",
    ],
    "random pulses": [
        "disturbance.pulse.random_count=3",
        "disturbance.pulse.random_until=0.2",
        "disturbance.pulse.duration=0.02",
        "disturbance.pulse.channel=trunk_effort",
        "disturbance.pulse.magnitude=4.0",
    ],
    "prescribed hip": ["simulator.hip.mode=prescribed"],
    "harmonics": ["simulator.path.cosines=[0.05, -0.02]", "simulator.path.sines=[0.01]"],
    "harmonics, prescribed": [
        "simulator.path.sines=[0.04, 0.02]",
        "simulator.hip.mode=prescribed",
        "simulator.path.amplitude=0.5",
        "simulator.path.wavenumber=1.5",
    ],
    "equations as printed": ["simulator.plant.equations=as_printed"],
    "fall": _FALLS,
    "fall that stops": [*_FALLS, "simulator.fall.stop=true"],
    "half the updates": ["LAW.update_rate=100.0"],
    "a fifth of the updates": ["LAW.update_rate=40.0", "simulator.sensor.delay=0.01"],
    "step": [
        "LAW.reference.profile=step",
        "LAW.reference.step_time=0.1",
        "LAW.reference.value=0.4",
    ],
    "reference sine": [
        "LAW.reference.profile=sine",
        "LAW.reference.amplitude=0.2",
        "LAW.reference.frequency=3.0",
    ],
    "sequence": [
        "LAW.reference.profile=sequence",
        "LAW.reference.times=[0.05, 0.15]",
        "LAW.reference.values=[0.2, -0.1]",
    ],
    "interpolated": [
        "LAW.reference.profile=interpolated",
        "LAW.reference.times=[0.0, 0.1, 0.2]",
        "LAW.reference.values=[0.0, 0.3, 0.1]",
    ],
    "derivative of the error": [
        "LAW.derivative_mode=error",
        "LAW.derivative_filter_time=0.02",
        "LAW.i_clamp_max=1.0",
        "LAW.i_clamp_min=-1.0",
    ],
    "pictures": ["recorder.markers=true"],
}
