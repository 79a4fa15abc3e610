"""What happens in an honest run in real time, drawn from a seed: its plan, and incidents during it."""

import random
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from ros2_ws.src.trunk_runs.test.random_plans import links_and_drives

from trunk_core.parameters.declarations import ParameterError, Value, build, values_of
from trunk_runs.plan import RunPlan, make_plan
from trunk_sim.config import TrunkSimulator

from ..tampering.honest import random_values

CONTROLLERS = ("pid", "fuzzy_pid", "lqr", "computed_torque")
RATES = (200.0, 250.0, 333.0, 500.0, 1000.0)
CLEAN = "clean"
_CLEAN_SHARE = 0.15
_STARTS = ("begin", "restart", "namesake", "stranger")  # a process


class Incident(NamedTuple):
    """Something that is done to a node, or by somebody else, so long after the start of the run."""

    at_s: float
    kind: str
    node: str = ""
    value: Any = None
    held: bool = False  # is the plant paused until a process that is started acts?

    def describe(self) -> str:
        """Return it as a few words."""
        words = [self.kind, self.node, "" if self.value is None else str(self.value)]
        words += [f"at {self.at_s:.3f} s", ", the plant waits" if self.held else ""]
        return " ".join(filter(None, words)).replace(" ,", ",")


class Trial(NamedTuple):
    """A run, and what happens to it."""

    seed: int
    controller: str
    second: str  # the controller that takes over; empty: none
    rate: float
    duration: float
    kinds: tuple[str, ...]  # of disturbance; none: a clean run
    incidents: tuple[Incident, ...]
    settings: tuple[tuple[str, object], ...]  # NODE.PARAMETER and value
    simulator: Mapping[str, Value]  # links and a drive
    recorder_last: bool = True  # of those that are stopped at the end

    def describe(self) -> str:
        """Return the trial as a line."""
        kinds = ", ".join(self.kinds) or CLEAN
        early = [] if self.recorder_last else ["recorder stopped first"]
        done = "; ".join([*map(Incident.describe, self.incidents), *early])
        return (
            f"seed {self.seed} ({kinds}; {self.controller}, {self.rate:g} Hz, "
            f"{self.duration:g} s){': ' if done else ''}{done}"
        )

    @property
    def absent(self) -> set[str]:
        """The nodes that are not started with the others."""
        begun = {incident.node for incident in self.incidents if incident.kind == "begin"}
        return begun | ({self.controller} if "stranger instead" in self.kinds else set())

    def plan(self) -> RunPlan:
        """Return the plan of its nodes."""
        plan = make_plan(
            "demo",
            self.controller,
            settings=[f"{name}={value}" for name, value in self.settings],
            everywhere={"duration": self.duration, "update_rate": self.rate},
            standby=[self.second] if self.second else (),
        )
        answers = {self.controller: "effort_command"}
        absent = {answers.get(name, name) for name in self.absent}
        values = {**values_of(plan.simulator), **self.simulator}
        values["wait_for"] = tuple(n for n in plan.simulator.wait_for if n not in absent)
        return replace(plan, simulator=build(TrunkSimulator, values))


class _Draft:
    """A trial while it is drawn."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(f"honest {seed}")
        self.rng = np.random.default_rng([9, seed])
        self.controller = self.chance.choice(CONTROLLERS)
        self.rate = self.chance.choice(RATES)
        self.duration = round(self.chance.uniform(1.0, 3.0), 1)
        self.second = ""
        self.incidents: list[Incident] = []
        self.settings: dict[str, object] = {}
        self.simulator: dict[str, Value] = {}
        self.recorder_last = True

    def when(self) -> float:
        return self.chance.uniform(0.0, self.duration)

    def add(self, kind: str, node: str = "", value: Any = None, at_s: float | None = None) -> None:
        held = kind in _STARTS and self.chance.random() < 0.5
        at_s = self.when() if at_s is None else at_s
        self.incidents.append(Incident(at_s, kind, node, value, held))

    # Kinds of disturbance.

    def controller_killed(self) -> None:
        self.add("kill", self.controller)

    def controller_restarted(self) -> None:
        self.add("restart", self.controller, round(self.chance.uniform(0.0, 1.0), 2))

    def disturbance_killed(self) -> None:
        self.add("kill", "disturbance")

    def disturbance_restarted(self) -> None:
        self.add("restart", "disturbance", round(self.chance.uniform(0.0, 1.0), 2))

    def simulator_killed(self) -> None:
        self.add("kill", "simulator")

    def simulator_restarted(self) -> None:
        """Stop the controller for a while first: states of the first run that it misses come again."""
        at_s = self.chance.uniform(0.2, 0.5) * self.duration
        self.add("stall", self.controller, self.chance.choice((0.1, 0.3, 0.5)), at_s=at_s)
        self.add(
            "restart",
            "simulator",
            self.chance.choice((0.0, 0.3)),
            at_s=at_s + self.chance.uniform(0.5, 1.2),
        )

    def recorder_killed(self) -> None:
        self.add("kill", "recorder")

    def recorder_late(self) -> None:
        self.add("begin", "recorder")

    def recorder_first(self) -> None:
        self.recorder_last = False

    def stalled(self) -> None:
        for _ in range(self.chance.choice((1, 1, 2, 4))):
            node = self.chance.choice((self.controller, "disturbance", "simulator", "recorder"))
            self.add("stall", node, round(self.chance.choice((0.01, 0.1, 1.0)), 2))

    def namesake(self) -> None:
        self.add("namesake", self.chance.choice((self.controller, "disturbance", "simulator")))

    def stopped_early(self) -> None:
        nodes = (self.controller, "disturbance", "simulator", "recorder")
        self.add("stop", self.chance.choice(nodes))

    def links(self) -> None:
        drawn = links_and_drives(self.rng, self.rate)
        self.simulator |= {n: v for n, v in drawn.items() if n.startswith("link.")}
        self.simulator["sensor.dropout"] = drawn["sensor.dropout"]

    def drive(self) -> None:
        drawn = links_and_drives(self.rng, self.rate)
        kept = (n for n in drawn if n.startswith(("actuator.", "sensor.")) and "dropout" not in n)
        self.simulator |= {name: drawn[name] for name in kept}

    def swapped(self) -> None:
        self.second = self.chance.choice([n for n in CONTROLLERS if n != self.controller])
        self.add("configure", self.second, at_s=0.0)
        for before, after in ((self.controller, self.second), (self.second, self.controller)):
            at_s = self.when()
            self.add("deactivate", before, at_s=at_s)
            self.add("activate", after, at_s=at_s + self.chance.choice((0.0, 0.05)))
            if self.chance.random() < 0.5:
                break

    def held(self) -> None:
        node = self.chance.choice((self.controller, "disturbance", "simulator"))
        at_s = self.when()
        self.add("deactivate", node, at_s=at_s)
        self.add("activate", node, at_s=at_s + self.chance.uniform(0.0, 0.3))

    def retuned(self) -> None:
        """Change parameters of every node; the values are drawn once the plan is known."""
        for node in (self.controller, "simulator", "disturbance", "recorder"):
            for _ in range(self.chance.choice((0, 1, 1, 2))):
                self.add("retune", node)

    def reset(self) -> None:
        for _ in range(self.chance.choice((1, 2))):
            self.add("reset", self.chance.choice((self.controller, "simulator")))

    def paused(self) -> None:
        at_s = self.when()
        self.add("pause", "simulator", value=True, at_s=at_s)
        self.add("pause", "simulator", value=False, at_s=at_s + self.chance.uniform(0.0, 0.4))

    def operator(self) -> None:
        self.settings["simulator.operator.torque"] = 20.0
        self.settings["simulator.operator.timeout"] = self.chance.choice((0.05, 0.25, 1.0))
        at_s, every_s = self.when(), self.chance.choice((0.005, 0.02, 0.1))
        for i in range(self.chance.choice((1, 5, 20))):
            torque = round(self.chance.uniform(-40.0, 40.0), 1)
            self.add("push", value=torque, at_s=at_s + i * every_s)

    def references(self) -> None:
        self.settings[f"{self.controller}.reference.profile"] = "topic"
        at_s = self.when()
        own = f"{self.controller}/reference" if self.chance.random() < 0.3 else "reference"
        for i in range(self.chance.choice((1, 10))):
            angle = round(self.chance.uniform(-0.5, 0.5), 3)
            self.add("refer", own, value=angle, at_s=at_s + 0.02 * i)

    def mistyped(self) -> None:
        own = f"{self.controller}/reference"
        self.add("mistype", self.chance.choice(("reference", own)))

    def stranger_with(self) -> None:
        self.add("stranger")

    def stranger_after(self) -> None:
        at_s = self.when()
        self.add("kill", self.controller, at_s=at_s)
        self.add("stranger", at_s=at_s + 0.05)

    def stranger_instead(self) -> None:
        """Start it with the others: the simulator waits for no controller of ours."""


KINDS: dict[str, tuple[float, Callable[[_Draft], None]]] = {
    "controller killed": (1.0, _Draft.controller_killed),
    "controller restarted": (1.0, _Draft.controller_restarted),
    "disturbance killed": (1.0, _Draft.disturbance_killed),
    "disturbance restarted": (1.0, _Draft.disturbance_restarted),
    "simulator killed": (0.3, _Draft.simulator_killed),
    "simulator restarted": (1.0, _Draft.simulator_restarted),
    "recorder killed": (0.5, _Draft.recorder_killed),
    "recorder late": (1.0, _Draft.recorder_late),
    "recorder first": (0.3, _Draft.recorder_first),
    "stalled": (1.5, _Draft.stalled),
    "namesake": (0.7, _Draft.namesake),
    "stopped early": (0.7, _Draft.stopped_early),
    "links": (1.0, _Draft.links),
    "drive": (1.0, _Draft.drive),
    "swapped": (1.0, _Draft.swapped),
    "held": (1.0, _Draft.held),
    "retuned": (2.0, _Draft.retuned),
    "reset": (1.0, _Draft.reset),
    "paused": (1.0, _Draft.paused),
    "operator": (1.0, _Draft.operator),
    "references": (0.7, _Draft.references),
    "mistyped": (0.7, _Draft.mistyped),
    "stranger with": (1.0, _Draft.stranger_with),
    "stranger after": (0.7, _Draft.stranger_after),
    "stranger instead": (0.7, _Draft.stranger_instead),
}


def draw(seed: int) -> Trial:
    """Return the trial of a seed."""
    draft = _Draft(seed)
    chance, kinds = draft.chance, list[str]()
    if chance.random() >= _CLEAN_SHARE:
        weights = [weight for weight, _ in KINDS.values()]
        drawn = chance.choices(list(KINDS), weights, k=chance.choice((1, 1, 2, 2, 3)))
        kinds = list(dict.fromkeys(drawn))
    for kind in kinds:
        KINDS[kind][1](draft)
    trial = Trial(
        seed,
        draft.controller,
        draft.second,
        draft.rate,
        draft.duration,
        tuple(kinds),
        tuple(sorted(draft.incidents, key=lambda incident: incident.at_s)),
        tuple(draft.settings.items()),
        draft.simulator,
        draft.recorder_last,
    )
    return trial._replace(incidents=_with_values(trial, draft.rng))


def _with_values(trial: Trial, rng: np.random.Generator) -> tuple[Incident, ...]:
    """Return the incidents with the values of changed parameters, each set allowed after those before."""
    configs = dict(trial.plan().configs)
    incidents = []
    for incident in trial.incidents:
        if incident.kind == "retune":
            config = configs[incident.node]
            values = random_values(config, rng, trial.duration)
            try:
                configs[incident.node] = build(type(config), {**values_of(config), **values})
            except ParameterError:
                continue
            if not values:
                continue
            incident = incident._replace(value=values)
        incidents.append(incident)
    return tuple(incidents)
