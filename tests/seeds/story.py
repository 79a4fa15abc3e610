"""What happens in a seed: a run, and faults drawn for it, each of which can be left out."""

import random
from typing import Any, NamedTuple

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from std_srvs.srv import SetBool, Trigger

from trunk_runs.plan import RunPlan, make_plan
from trunk_sim.disturbances import CHANNELS

NS = 1_000_000_000
CONTROLLERS = ("pid", "fuzzy_pid", "lqr")
_TRANSITIONS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4, "shutdown": 7}


class Fault(NamedTuple):
    """Something that happens to a node at a time."""

    at_ns: int
    kind: str
    node: str
    value: float = 0.0
    running: bool = False  # the time counts from the first measured state

    def describe(self) -> str:
        """Return it as a line."""
        since = " of the run" if self.running else ""
        value = f" {self.value:g}" if self.value else ""
        return f"{self.at_ns / NS:.6f} s{since}: {self.kind} {self.node}{value}"


class Story(NamedTuple):
    """A run, and what happens to it."""

    seed: int
    lockstep: bool
    controller: str
    duration: float
    faults: tuple[Fault, ...]
    settings: tuple[str, ...] = ()  # NODE.PARAMETER=VALUE
    whole: bool = False  # whatever happens, it is complete and verifies

    def plan(self, **more: object) -> RunPlan:
        """Return the plan of the nodes; ``more``: parameters for each node that has them."""
        everywhere: dict[str, object] = {"duration": self.duration, **more}
        if self.lockstep:
            everywhere["lockstep.enabled"] = True
        return make_plan("demo", self.controller, settings=self.settings, everywhere=everywhere)


# How often each kind is drawn; "node" is chosen among these.
_KINDS: tuple[tuple[str, int, tuple[str, ...]], ...] = (
    ("stall", 6, ("simulator", "controller", "disturbance", "recorder")),
    ("crash", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("restart", 3, ("controller", "disturbance", "recorder")),
    ("stop", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("late", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("clock", 2, ("",)),
    ("second", 1, ("controller",)),
    ("full", 2, ("recorder",)),
    ("reset", 3, ("simulator", "controller")),
    ("pause", 3, ("simulator",)),
    ("gains", 4, ("controller",)),
    ("deactivate", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("activate", 3, ("simulator", "controller", "disturbance", "recorder")),
    ("cleanup", 1, ("controller",)),
)


def draw(seed: int) -> Story:
    """Return the story of a seed; some have no fault at all."""
    chance = random.Random(f"story {seed}")
    lockstep = chance.random() < 0.6
    controller = chance.choice(CONTROLLERS)
    duration = chance.choice((0.05, 0.1, 0.2))
    faults = []
    for _ in range(chance.choice((0, 1, 1, 2, 2, 3, 5))):
        kind, _, some = chance.choices(_KINDS, [weight for _, weight, _ in _KINDS])[0]
        node = chance.choice(some)
        node = controller if node == "controller" else node
        running = chance.random() < 0.6
        # If not running: before it begins, or at any time.
        at = chance.choice((chance.uniform(0.0, 0.6), chance.uniform(0.3, 3.0)))
        at_ns = round((chance.uniform(0.0, 1.5 * duration) if running else at) * NS)
        value = {
            "stall": chance.choice((0.01, 0.1, 1.0, 6.0)) * chance.uniform(0.5, 1.5),
            "late": chance.uniform(0.1, 3.0),
            "clock": chance.uniform(-100.0, 100.0),
            "gains": chance.uniform(20.0, 80.0),
        }.get(kind, 0.0)
        faults.append(Fault(at_ns, kind, node, value, running))
    settings = () if lockstep else draw_settings(seed, duration)
    return Story(seed, lockstep, controller, duration, tuple(sorted(faults)), settings)


def draw_settings(seed: int, duration: float) -> tuple[str, ...]:
    """Return settings with which disturbances and commands may act late, or be too old to act."""
    chance = random.Random(f"settings {seed}")
    # The first value is the most frequent one.
    values: dict[str, tuple[object, ...]] = {
        "simulator.command_timeout": (0.2, 0.005, 0.02, 0.05),
        "simulator.hip.mode": ("passive", "prescribed"),
        "simulator.sensor.position_resolution": (0.0, 0.01),
        "simulator.sensor.delay": (0.0, 0.01),
        "simulator.actuator.time_constant": (0.0, 0.01),
        "simulator.actuator.dead_band": (0.0, 1.0),
        "simulator.max_effort": (".inf", 1.0),
        "disturbance.pulse.channel": CHANNELS,
        "disturbance.pulse.duration": (0.005, 0.01, 0.03),
        "disturbance.sine.channel": CHANNELS,
        "disturbance.sine.amplitude": (0.0, 1e-4, 0.1),
        "disturbance.sine.frequency": (1.0, 10.0),
        "disturbance.noise.channel": CHANNELS,
        "disturbance.noise.rms": (0.0, 0.01),
    }
    drawn = {name: chance.choice((some[0], *some)) for name, some in values.items()}
    starts = {round(chance.uniform(0.0, duration), 3) for _ in range(chance.choice((1, 3)))}
    drawn["disturbance.pulse.start_times"] = sorted(starts)
    return tuple(f"{name}={value}" for name, value in drawn.items())


class Request(NamedTuple):
    """A call of a node's service."""

    service: str  # its name
    kind: Any
    fields: dict[str, Any]


def requests(fault: Fault) -> tuple[Request, ...]:
    """Return the calls of services that a fault consists of, if any; each a while after the last one."""
    name, kind = f"/{fault.node}", fault.kind
    if kind == "reset":
        return (Request(f"{name}/reset", Trigger, {}),)
    if kind == "pause":
        return tuple(Request(f"{name}/pause", SetBool, {"data": hold}) for hold in (True, False))
    if kind == "gains":
        key = {
            "fuzzy_pid": "gains.p_max",
            "lqr": "u_clamp_max",
            "simulator": "plant.length",
        }.get(fault.node, "gains.p")
        value = Parameter(name=key, value=ParameterValue(type=3, double_value=fault.value))
        service = f"{name}/set_parameters_atomically"
        return (Request(service, SetParametersAtomically, {"parameters": [value]}),)
    if kind in _TRANSITIONS:
        transition = ChangeState.Request().transition
        transition.id = _TRANSITIONS[kind]
        return (Request(f"{name}/change_state", ChangeState, {"transition": transition}),)
    return ()


def _in_turn(*words: str) -> tuple[Fault, ...]:
    """Return faults as ``KIND NODE VALUE``, from 0.1 s of the run on, every 50 ms."""
    faults = []
    for i, line in enumerate(words):
        kind, node, *value = line.split()
        faults.append(Fault((2 + i) * NS // 20, kind, node, *map(float, value), running=True))
    return tuple(faults)


# What no seed draws in this order.
STORIES = {
    "turns and changes while the plant rests": Story(
        *(1, False, "pid", 2.0),
        _in_turn(
            *("deactivate simulator", "gains pid 35", "deactivate pid", "gains pid 85"),
            *("activate pid", "gains pid 45", "reset pid", "gains pid 55"),
            *("gains simulator 1.035", "reset simulator", "activate simulator"),
            *("deactivate simulator", "deactivate pid", "gains pid 60", "activate pid"),
            *("gains simulator 1.005", "reset simulator", "activate simulator"),
        ),
        whole=True,
    ),
    "held in every way": Story(
        *(2, False, "pid", 1.0),
        _in_turn(
            *("pause simulator", "pause simulator", "deactivate simulator", "activate simulator"),
            *("reset simulator", "pause simulator"),
        ),
        whole=True,
    ),
    "ended by a fall": Story(
        *(3, False, "pid", 3.0, ()),
        ("simulator.fall.angle=0.01", "simulator.fall.stop=true"),
        whole=True,
    ),
    "a disturbance that hangs in its pulse": Story(
        *(5, False, "pid", 0.5, _in_turn("stall disturbance 0.2")),
        (
            *("simulator.command_timeout=0.05", "disturbance.pulse.channel=trunk_position"),
            *("disturbance.pulse.start_times=[0.0]", "disturbance.pulse.duration=3600.0"),
        ),
        whole=True,
    ),
    "a controller that ends before anybody configured it": Story(
        *(138, True, "pid", 0.05),
        (Fault(474092701, "stop", "pid"), Fault(1474092701, "stop", "simulator")),
        ("pid.autostart=false",),
    ),
    "in lock-step": Story(4, True, "pid", 0.2, (), whole=True),
}
