"""Random plans over every declared parameter, for comparing compiled code with CPython.

A value is drawn from its declaration; one that decides how long a run lasts (a mass, a limit, a time
during the run) is drawn near its usual value. A new parameter needs no change here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from trunk_control.rule_tables import ALPHA_LABELS, GAIN_LABELS
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    Value,
    build,
    declarations,
)
from trunk_runs.nodes import CONTROLLERS, NODES
from trunk_runs.plan import RunPlan, Swap, make_plan, turns_of
from trunk_sim.config import TrunkSimulator

STEPS = 250
_RATES = (
    60.0,
    144.0,
    200.0,
    333.0,
    700.0,
    1000.0,
    4000.0,
)  # Hz; for some the period is not a whole number of ns
_OFTEN_DEFAULT = 0.4
# Who acts, in turns; only a few orders, because each is compiled separately.
_FIRST = CONTROLLERS[:4]
_PARTIES: tuple[tuple[str, ...], ...] = (
    *((name,) for name in _FIRST),
    *((name,) for name in _FIRST),
    _FIRST,
    _FIRST[1::-1],
)
# The plans before stay as they were frozen; those from here on also have any law, and rule bases of any size.
ANY_LAW = 200
_LATER_PARTIES = (
    *_PARTIES,
    *((name,) for name in CONTROLLERS[4:]),
    *(("fuzzy", "fuzzy_pid"), ("state_feedback", "lqr")),
)


# None of these is drawn, so that seeds give the plans that they always gave.
NOT_DRAWN = {"gap.max_periods"}
OF_FUZZY_PID = {
    *(f"fuzzy.{name}_labels" for name in ("error", "rate", "kp", "kd", "alpha")),
    *("fuzzy.kp_centers", "fuzzy.kd_centers"),
}


@dataclass(frozen=True)
class Draw:
    """Draws values of declared parameters."""

    rng: np.random.Generator
    duration: float  # s

    def pick(self, *values: Any) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def element(self, d: Declaration, near: float) -> Any:
        """Return one allowed element, of about the size of ``near``."""
        kind = d.kind.removesuffix(" array")
        if d.choices:
            return self.pick(*d.choices)
        if kind == "bool":
            return bool(self.rng.integers(2))
        low = d.minimum if d.minimum is not None else d.above if d.above is not None else -inf
        high = d.maximum if d.maximum is not None else inf
        if kind == "integer":
            return int(self.rng.integers(int(low), int(min(high, max(low + 1, 3.0 * near))) + 1))
        if d.unit == "s":  # some time of the run
            return float(np.clip(self.rng.uniform(0.0, 1.2 * self.duration), low, high))
        if d.above is not None:
            size = abs(near) if 0.0 < abs(near) < inf else 1.0
            return float(min(size * 10.0 ** self.rng.uniform(-1.0, 1.0), high))
        size = abs(near) if 0.0 < abs(near) < inf else 1.0
        return float(np.clip(self.rng.uniform(-2.0, 2.0) * size, low, high))

    def value(self, d: Declaration) -> Value:
        """Return an allowed value of a parameter, usually not the default."""
        if self.rng.random() < _OFTEN_DEFAULT:
            return d.default
        if not d.kind.endswith("array"):
            near = d.default if isinstance(d.default, int | float) else 0.0
            return d.default if d.kind == "string" and not d.choices else self.element(d, near)
        default = d.default if isinstance(d.default, tuple) else ()
        sized = d.length is not None or d.shortest  # tables and their labels keep their size
        count = len(default) if sized else int(self.rng.integers(5))
        if d.name.startswith("rules."):
            labels = ALPHA_LABELS if d.name == "rules.alpha" else GAIN_LABELS
            return tuple(" ".join(self.pick(*labels) for _ in range(7)) for _ in range(count))
        if d.kind != "double array":
            return d.default
        near = max((abs(float(v)) for v in default), default=1.0)
        drawn = [float(self.element(d, near)) for _ in range(count)]
        ascend = d.name.endswith(("times", "peaks"))
        return tuple(sorted(drawn) if ascend else drawn)

    def config(self, node: str, **given: Any) -> Any:
        """Return a node's configuration; a value that does not fit the rest gets its default."""
        declared = declarations(NODES[node].config)
        skipped = NOT_DRAWN | (OF_FUZZY_PID if node == "fuzzy_pid" else set())
        values = {name: self.value(d) for name, d in declared.items() if name not in skipped}
        values["autostart"] = bool(self.rng.random() > 0.02)
        values.update(given)
        while True:
            try:
                return build(NODES[node].config, values)
            except ParameterError as error:
                group = error.name.split(".")[0]
                usual = {n: d.default for n, d in declared.items() if n.split(".")[0] == group}
                if usual.items() <= values.items():
                    raise
                values.update(usual)


def random_plan(index: int) -> RunPlan:
    """Return the index-th random plan: some diverge, some fall, some hand over between controllers."""
    rng = np.random.default_rng([1963, index])
    rate = float(rng.choice(_RATES))
    draw = Draw(rng, STEPS / rate)
    simulator = draw.config("simulator", **_simulator(draw, rate))
    disturbance = draw.config(
        "disturbance", update_rate=rate, joints=simulator.joints, **_disturbance(draw)
    )
    parties = _PARTIES if index < ANY_LAW else _LATER_PARTIES
    first, *others = parties[int(rng.integers(len(parties)))]
    times = sorted(rng.uniform(0.0, draw.duration, 4 if others else 0).tolist())
    order = [*others, first]
    swaps = [Swap(time, order[i % len(order)]) for i, time in enumerate(times)]
    turns = turns_of(first, swaps)
    controllers = {
        name: replace(
            draw.config(name, **_controller(draw, name, rate), **sized(draw, name, index)),
            active_times=active if swaps else (),
        )
        for name, active in turns.items()
    }
    return RunPlan(
        scenario=f"random {index}",
        simulator=simulator,
        controllers=controllers,
        disturbance=disturbance if disturbance.active else None,
        recorder=make_plan("demo", first).recorder,
    )


_LINKED = 0.3  # share of the runs with links
# Of a real drive and of real sensors: what changes nothing, and the largest value drawn.
_REAL_DRIVE = (
    ("actuator.time_constant", 0.0, 0.1),
    ("actuator.rate_limit", inf, 5000.0),
    ("actuator.dead_band", 0.0, 3.0),
    ("actuator.resolution", 0.0, 5.0),
    ("actuator.bias", 0.0, 5.0),
    ("actuator.coulomb_friction", 0.0, 3.0),
    ("actuator.viscous_friction", 0.0, 3.0),
    ("sensor.position_resolution", 0.0, 0.05),
    ("sensor.velocity_resolution", 0.0, 0.5),
    ("sensor.position_limit", inf, 3.0),
    ("sensor.velocity_limit", inf, 30.0),
)


def _simulator(draw: Draw, rate: float) -> dict[str, Value]:
    """Return the values that keep a run in bounds, or that depend on one another."""
    printed = draw.rng.random() < 0.1
    values: dict[str, Value] = {
        "update_rate": rate,
        "duration": draw.duration,
        "substeps": int(draw.rng.integers(1, 5)),
        "joints": ("hip", "trunk"),
        "initial.position": tuple(draw.rng.uniform(-2.0, 2.0, 2).tolist()),
        "initial.velocity": tuple(draw.rng.uniform(-3.0, 3.0, 2).tolist()),
        "max_effort": draw.pick(inf, float(draw.rng.uniform(5.0, 200.0))),
        "fall.angle": draw.pick(inf, float(draw.rng.uniform(0.3, 3.0))),
        "sensor.delay": draw.pick(0.0, float(draw.rng.uniform(0.0, 12.0 / rate))),
        "plant.equations": "as_printed" if printed else "derived",
        **_series(draw, "path."),
    }
    for name in ("sensor.position_noise", "sensor.velocity_noise"):
        values[name] = draw.pick(0.0, float(draw.rng.uniform(0.0, 0.3)))
    values.update(_drive(draw))
    values.update(_links(draw, rate, bool(draw.rng.random() < _LINKED)))
    if printed:
        values.update({"path.amplitude": 1.0, "path.wavenumber": 1.0, "hip.mode": "passive"})
        values.update({"path.cosines": (), "path.sines": ()})
    return values


def links_and_drives(rng: np.random.Generator, rate: float) -> dict[str, Value]:
    """Return values of the simulator's parameters for links and, often, for a real drive and sensors."""
    draw = Draw(rng, 1.0)
    return {**_drive(draw), **_links(draw, rate, True)}


def _drive(draw: Draw) -> dict[str, Value]:
    return {
        name: draw.pick(neutral, float(draw.rng.uniform(1e-3, 1.0)) * most)
        for name, neutral, most in _REAL_DRIVE
    }


def _links(draw: Draw, rate: float, linked: bool) -> dict[str, Value]:
    """Return values of both links and of failing measurements."""
    declared = declarations(TrunkSimulator)
    usual = {name: d.default for name, d in declared.items() if name.startswith("link.")}
    values: dict[str, Value] = {**usual, "sensor.dropout": 0.0}
    rng = draw.rng
    if linked:
        values["sensor.dropout"] = draw.pick(0.0, float(rng.uniform(0.0, 0.5)))
        values["link.command.missing"] = draw.pick("hold", "zero")
        values["link.seed"] = int(rng.integers(100))
    for prefix in ("link.state.", "link.command.") if linked else ():
        values |= {
            prefix + "delay": draw.pick(0.0, float(rng.uniform(0.0, 6.0 / rate))),
            prefix + "jitter": draw.pick(0.0, float(rng.uniform(0.0, 6.0 / rate))),
            prefix + "jitter_kind": draw.pick("uniform", "exponential"),
            prefix + "loss": draw.pick(0.0, float(rng.uniform(0.0, 0.4))),
            prefix + "burst.begin": draw.pick(0.0, float(rng.uniform(0.0, 0.1))),
            prefix + "burst.end": float(rng.uniform(0.05, 1.0)),
            prefix + "burst.loss": float(rng.uniform(0.0, 1.0)),
            prefix + "duplicates": draw.pick(0.0, float(rng.uniform(0.0, 0.5))),
            prefix + "order": draw.pick("latest", "arrival"),
        }
    return values


def _disturbance(draw: Draw) -> dict[str, Value]:
    """Return values that depend on one another: a table of up to four rows, a span of random pulses."""
    begin, end = sorted(draw.rng.uniform(0.0, draw.duration, 2).tolist())
    rows = int(draw.rng.integers(5))
    return {
        "pulse.random_count": draw.pick(0, int(draw.rng.integers(1, 6))),
        "pulse.random_from": begin,
        "pulse.random_until": end,
        "table.times": tuple(sorted(draw.rng.uniform(0.0, draw.duration, rows).tolist())),
        "table.values": tuple(draw.rng.uniform(-2.0, 2.0, rows).tolist()),
    }


def _series(draw: Draw, prefix: str) -> dict[str, Value]:
    """Return small coefficients of a path: a higher harmonic is steeper. Often none."""
    counts = draw.rng.integers(4, size=2).tolist() if draw.rng.random() < 0.3 else (0, 0)
    return {
        f"{prefix}{name}": tuple(draw.rng.uniform(-0.1, 0.1, count).tolist())
        for name, count in zip(("cosines", "sines"), counts, strict=True)
    }


def rule_base(draw: Draw, node: str, rows: int, columns: int) -> dict[str, Value]:
    """Return random peaks, labels and tables of a size, the cells labels and numbers."""
    rng = draw.rng
    low = {"kp": 0.0, "kd": 0.0, "alpha": 0.1, "u": -1.0}
    values: dict[str, Value] = {}
    for axis, count in (("error", rows), ("rate", columns)):
        edges = np.cumsum(rng.uniform(0.1, 1.0, count + 1))
        values[f"fuzzy.{axis}_peaks"] = tuple((2.0 * edges[:-1] / edges[-1] - 1.0).tolist())
        values[f"fuzzy.{axis}_labels"] = tuple(f"{axis[0]}{i}" for i in range(count))
    for output in ("u",) if node == "fuzzy" else ("kp", "kd", "alpha"):
        labels = tuple(f"L{i}" for i in range(int(rng.integers(1, 6))))
        name = {"u": "output"}.get(output, output)
        values[f"fuzzy.{name}_labels"] = labels
        values[f"fuzzy.{name}_centers"] = tuple(rng.uniform(low[output], 1.0, len(labels)).tolist())
        cells = [
            draw.pick(*labels, repr(float(rng.uniform(low[output], 1.0))))
            for _ in range(rows * columns)
        ]
        values[f"rules.{output}"] = tuple(
            " ".join(cells[i * columns : (i + 1) * columns]) for i in range(rows)
        )
    return values


def sized(draw: Draw, node: str, index: int) -> dict[str, Value]:
    """Return a rule base of any size for a plan that may have one, else nothing."""
    if index < ANY_LAW or node not in ("fuzzy", "fuzzy_pid"):
        return {}
    return rule_base(draw, node, *draw.rng.integers(2, draw.pick(5, 8, 65), 2).tolist())


def _of_a_model(draw: Draw) -> dict[str, Value]:
    return {"hip_joint": draw.pick("hip", "hip", "trunk"), **_series(draw, "model.path_")}


def _hip(draw: Draw, name: str) -> dict[str, Value]:
    return {"hip_joint": draw.pick("hip", "hip", "trunk")} if name == "state_feedback" else {}


def _controller(draw: Draw, name: str, rate: float) -> dict[str, Value]:
    limit = draw.pick(inf, float(draw.rng.uniform(5.0, 100.0)))
    profile = draw.pick("constant", "step", "sine", "sequence", "interpolated", "topic")
    if draw.rng.random() < 0.8 and profile == "topic":
        profile = "step"
    times = sorted(draw.rng.uniform(0.0, draw.duration, 3).tolist())
    return {
        "update_rate": rate / int(draw.rng.integers(1, 6)),
        "joint": "trunk",
        **(_of_a_model(draw) if name == "computed_torque" else {}),
        **_hip(draw, name),
        "u_clamp_max": limit,
        "u_clamp_min": -limit,
        "reference.profile": profile,
        "reference.times": tuple(times),
        "reference.values": tuple(draw.rng.uniform(-1.0, 1.0, 3).tolist()),
    }


DISTURBED = (
    "simulator.sensor.position_noise=0.004",
    "simulator.sensor.velocity_bias=0.01",
    "simulator.sensor.delay=0.01",
    "disturbance.pulse.start_times=[0.1, 0.3]",
    "disturbance.pulse.magnitude=3.0",
    "disturbance.pulse.channel=trunk_effort",
    "disturbance.sine.amplitude=0.4",
    "disturbance.noise.rms=0.3",
)


def several(
    name: str,
    settings: Sequence[str] = (),
    count: int = 12,
    duration: float = 0.6,
    rate: float = 500.0,
) -> list[RunPlan]:
    """Return plans of different trunks, references, disturbances and noises."""
    everywhere = {"duration": duration, "update_rate": rate}
    plan = make_plan("fig8", name, settings=settings, everywhere=everywhere)
    rng = np.random.default_rng(5)
    plans = []
    for i in range(count):
        mass, angle, level = rng.uniform([0.3, -0.5, 0.1], [0.8, 0.5, 0.4]).tolist()
        simulator = replace(
            plan.simulator, trunk_mass=mass, initial_position=(0.0, angle), seed=7 + i
        )
        disturbance = plan.disturbance
        if disturbance is not None:
            starts = (0.1 * level, 0.3 + 0.1 * level)
            disturbance = replace(disturbance, pulse_start_times=starts, noise_seed=i)
        controller = replace(plan.controller, reference_amplitude=level)
        plans.append(
            replace(
                plan,
                scenario=f"{name} {i}",
                simulator=simulator,
                disturbance=disturbance,
                controllers={name: controller},
            )
        )
    return plans
