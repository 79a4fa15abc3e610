"""Runs that differ in what a path has to repeat, as words of the command line and as plans."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from ros2_ws.src.trunk_runs.test.random_plans import links_and_drives

from trunk_core.parameters.declarations import build, values_of
from trunk_core.topics import Event
from trunk_runs.plan import RunPlan, make_plan, parse_swap
from trunk_runs.timeline import Change
from trunk_sim.config import TrunkSimulator

_HERE = Path(__file__).parent
_MS = 1_000_000
LINKS = (
    "simulator.link.state.delay=12ms",
    "simulator.link.state.jitter=10ms",
    "simulator.link.state.loss=0.1",
    "simulator.link.command.jitter=8ms",
    "simulator.link.command.burst.begin=0.03",
    "simulator.link.command.burst.end=0.3",
    "simulator.link.command.order=arrival",
    "simulator.sensor.dropout=0.1",
    "simulator.sensor.position_noise=0.001",
)
_MORE_LINKS = (
    *LINKS,
    "simulator.link.state.order=arrival",
    "simulator.link.command.jitter_kind=exponential",
    "simulator.link.command.duplicates=0.2",
    "simulator.link.command.missing=zero",
)
_DRIVE = (
    "simulator.actuator.time_constant=0.02",
    "simulator.actuator.rate_limit=2000",
    "simulator.actuator.dead_band=0.2",
    "simulator.actuator.resolution=0.05",
    "simulator.actuator.bias=-0.3",
    "simulator.actuator.coulomb_friction=0.1",
    "simulator.actuator.viscous_friction=0.05",
    "simulator.sensor.position_resolution=0.001",
    "simulator.sensor.velocity_resolution=0.01",
    "simulator.sensor.position_limit=1.2",
)
_NOISE = (
    "simulator.sensor.position_noise=0.002",
    "simulator.sensor.velocity_noise=0.01",
    "simulator.sensor.delay=0.035",
)
_DISTURBED = (
    "disturbance.noise.rms=3",
    "disturbance.sine.amplitude=20",
    "disturbance.pulse.start_times=[0.3, 0.8]",
)
_GAIT = (
    "simulator.path.cosines=[0.004, -0.012, 0.001]",
    "simulator.path.sines=[-0.003, 2cm]",
    "computed_torque.model.path_cosines=[0.004, -0.012, 0.001]",
    "computed_torque.model.path_sines=[-0.003, 2cm]",
)
_FILES = (
    "pid.reference.profile=interpolated",
    f"pid.reference.file={_HERE / 'ref.csv'}",
    f"disturbance.table.file={_HERE / 'push.csv'}",
    "disturbance.pulse.start_times=[0.05]",
    "disturbance.pulse.duration=20ms",
    "disturbance.pulse.magnitude=10deg",
    "disturbance.pulse.random_count=3",
    "disturbance.pulse.random_until=0.5",
)
_FALL = ("simulator.fall.stop=true", "simulator.fall.angle=0.6", "pid.gains.i=0.0")


class Scenario(NamedTuple):
    """A run: a scenario's file, a controller, seconds, and what is set, swapped or changed by hand."""

    file: str
    controller: str
    duration: float
    settings: tuple[str, ...] = ()
    swaps: tuple[str, ...] = ()
    changes: Mapping[str, list[Change]] = {}
    references: Mapping[int, float] = {}

    def plan(self, lockstep: bool = False) -> RunPlan:
        """Return the plan; ``lockstep``: of a run in the graph."""
        made = make_plan(
            self.file,
            self.controller,
            settings=self.settings,
            everywhere={
                "duration": self.duration,
                **({"lockstep.enabled": True} if lockstep else {}),
            },
            swaps=tuple(map(parse_swap, self.swaps)),
        )
        return replace(made, changes=dict(self.changes), references=dict(self.references))

    @property
    def words(self) -> list[object]:
        """The same for ``trunk run``."""
        assert not self.changes, "there are no words for changes by hand"
        words: list[object] = [self.file, "--controller", self.controller]
        words += ["--duration", self.duration]
        words += [word for setting in self.settings for word in ("--set", setting)]
        return words + [word for swap in self.swaps for word in ("--swap-at", swap)]


SCENARIOS = {
    "fuzzy": Scenario("fig8", "fuzzy_pid", 1.2),
    "noise and delay": Scenario("demo", "pid", 1.5, _NOISE),
    "swaps": Scenario("demo", "pid", 1.5, (), ("0.4:fuzzy_pid", "0.9:lqr", "1.2:pid")),
    "pictures": Scenario("fig9", "pid", 0.6, ("recorder.markers=true",), ("0.25:lqr",)),
    "a slow controller": Scenario(
        "demo", "computed_torque", 1.5, ("computed_torque.update_rate=50",)
    ),
    # 2 * 1428571 ns are 1 ns less than 2857143 ns.
    "periods that fit by rounding": Scenario(
        "fig8",
        "pid",
        0.5,
        ("pid.update_rate=350", "pid.derivative_mode=rate", "simulator.update_rate=700"),
    ),
    "disturbed": Scenario("demo", "lqr", 1.5, _DISTURBED),
    "feedback of the hip": Scenario(
        *("demo", "state_feedback", 1.0),
        ("state_feedback.gains.x=-3", "state_feedback.gains.v=-2"),
    ),
    "files and random pulses": Scenario("demo", "pid", 0.5, _FILES),
    "held tables": Scenario(
        *("demo", "pid", 0.5),
        (*_FILES, "disturbance.table.interpolation=hold", "pid.reference.profile=sequence"),
    ),
    "a gait": Scenario("fig6", "computed_torque", 0.4, _GAIT),
    "a cart-pole": Scenario(
        *("fig6", "pid", 1.2),
        (
            *("simulator.plant.name=cart_pole", "simulator.initial.position=[0, 10deg]"),
            *("pid.gains.p=60", "pid.gains.d=12", "simulator.plant.friction=0.3", *_NOISE),
            *("simulator.actuator.time_constant=0.02", "simulator.actuator.coulomb_friction=0.1"),
            *("disturbance.noise.channel=pole_effort", "disturbance.noise.rms=0.1"),
            *("disturbance.pulse.channel=cart_effort", "disturbance.pulse.start_times=[0.3]"),
            "disturbance.pulse.magnitude=5",
        ),
        ("0.7:lqr",),
    ),
    "a drive": Scenario("demo", "fuzzy_pid", 1.5, _DRIVE),
    "links": Scenario("demo", "pid", 1.0, LINKS),
    "more links": Scenario("demo", "fuzzy_pid", 1.5, _MORE_LINKS),
    "a sensor that always fails": Scenario(
        "demo", "pid", 0.3, (*LINKS, "simulator.sensor.dropout=1")
    ),
    "a fall": Scenario("fig8", "pid", 1.2, ("simulator.fall.angle=0.53",)),
    "an end by a fall": Scenario("fig8", "pid", 10.0, _FALL),
    "a fall in the first state": Scenario(
        "demo", "pid", 0.5, ("simulator.fall.stop=true", "simulator.fall.angle=0.5")
    ),
    "divergence": Scenario("fig6", "pid", 2.0, ("pid.gains.d=5000",)),
    "changes": Scenario(
        *("demo", "fuzzy_pid", 1.5, ("recorder.markers=true",)),
        changes={
            "fuzzy_pid": [
                Change(-1, {"fuzzy.consequents": "log"}),
                Change(250 * _MS, {"u_clamp_max": 30.0}),
                Change(700 * _MS, None, Event.RESET),
            ],
            "simulator": [
                Change(500 * _MS, {"max_effort": 12.0}),
                Change(600 * _MS, {"plant.length": 1.1}),
                Change(900 * _MS, None, Event.RESET),
            ],
            "disturbance": [Change(1050 * _MS, {"pulse.magnitude": 0.3})],
        },
    ),
    "links and changes": Scenario(
        *("demo", "pid", 1.0, LINKS),
        changes={
            "simulator": [
                Change(300 * _MS, {"sensor.position_bias": 0.1, "sensor.position_noise": 0.0}),
                Change(500 * _MS, None, Event.RESET),
                Change(515 * _MS, {"max_effort": 20.0}),
            ]
        },
    ),
    "a path that changes": Scenario(
        *("fig6", "computed_torque", 0.4, _GAIT),
        changes={
            "simulator": [
                Change(50 * _MS, {"path.sines": (), "path.cosines": ()}),
                Change(120 * _MS, {"path.cosines": (0.01,)}),
            ]
        },
    ),
    "turns by hand": Scenario(
        *("fig8", "pid", 1.2),
        changes={
            "pid": [
                Change(0, None, Event.DEACTIVATED),
                Change(400 * _MS, None, Event.ACTIVATED),
            ]
        },
    ),
    "references by topic": Scenario(
        *("fig6", "pid", 0.3, ("simulator.update_rate=200", "pid.update_rate=200")),
        changes={
            "pid": [
                Change(50 * _MS, {"reference.profile": "topic"}),
                Change(200 * _MS, {"reference.profile": "constant"}),
            ]
        },
        references={k * 5 * _MS: 0.25 for k in range(61)},
    ),
}


def random_links(index: int, seed: int) -> RunPlan:
    """Return the plan of a short run with links, and often with a real drive and real sensors."""
    rng = np.random.default_rng([seed, index])
    file = ("demo", "fig8")[int(rng.integers(2))]
    name = ("pid", "fuzzy_pid", "lqr", "computed_torque")[int(rng.integers(4))]
    everywhere = {"duration": float(rng.uniform(0.2, 0.6)), "lockstep.enabled": True}
    plan = make_plan(file, name, everywhere=everywhere)
    values = values_of(plan.simulator) | links_and_drives(rng, plan.simulator.update_rate)
    return replace(plan, simulator=build(TrunkSimulator, values))
