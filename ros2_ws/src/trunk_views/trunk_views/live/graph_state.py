"""What is known of a running graph's nodes: parameters, states, events, health. Pure."""

from __future__ import annotations

from collections import defaultdict, deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from trunk_control.law import ControllerConfig
from trunk_control.laws import law_of
from trunk_control.rule_base import RuleBaseConfig
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    build,
    declarations,
    values_of,
)
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.topics import ENDS, Event
from trunk_core.units import seconds
from trunk_evidence.parameter_text import transitions_text
from trunk_msgs_util.picture.frames import as_data
from trunk_msgs_util.picture.shapes import Geometry
from trunk_runs.nodes import config_class
from trunk_sim.config import SimulatorConfig, TrunkSimulator

from .feed import plain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .feed import Board

_DRAG_S = 2.0  # between two values of a slider that is dragged, at ten times real time
_EVENTS = 300  # that a page can look back to, from when it is opened
_STATES = {
    Event.CONFIGURED: "inactive",
    Event.ACTIVATED: "active",
    Event.DEACTIVATED: "inactive",
    Event.CLEANED_UP: "unconfigured",
}


@dataclass(eq=False)
class _Listed:
    number: int
    stamp_ns: int
    node: str
    event: str
    values: dict[str, str]
    before: Mapping[str, Any] = field(default_factory=dict)
    after: dict[str, Any] = field(default_factory=dict)
    changed: str = ""  # before and after, as text

    @property
    def t(self) -> float:
        return max(seconds(self.stamp_ns), 0.0)

    def take(self, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
        self.before = self.before or before
        self.after.update(after)
        self.changed = transitions_text(self.before, self.after)

    def as_values(self) -> dict[str, object]:
        names = ("number", "t", "node", "event", "values", "changed")
        return {name: getattr(self, name) for name in names}


class _Change(NamedTuple):
    stamp_ns: int
    before: Mapping[str, Any]
    after: Mapping[str, Any]


class _Unpaired:
    """A node's events and changes of parameters whose counterpart has not come yet."""

    def __init__(self, kept: int) -> None:
        self.events: deque[_Listed] = deque(maxlen=kept)
        self.changes: deque[_Change] = deque(maxlen=kept)


class EventList:
    """The last ``kept`` events. A slider that is dragged makes one."""

    def __init__(self, kept: int) -> None:
        self.dropped = 0
        self._kept = kept
        self._number = 0  # of the last event
        self._events: deque[_Listed] = deque(maxlen=kept)
        self._unpaired: defaultdict[str, _Unpaired] = defaultdict(lambda: _Unpaired(kept))

    def add(self, node: str, stamp_ns: int, message: str, values: Mapping[str, str]) -> None:
        """Take an event."""
        self._number += 1
        self.dropped += len(self._events) == self._kept
        self._events.append(_Listed(self._number, stamp_ns, node, message, dict(values)))
        if message == Event.RETUNED:
            self._unpaired[node].events.append(self._events[-1])
            self._pair(node)

    def change(
        self, node: str, stamp_ns: int, before: Mapping[str, Any], after: Mapping[str, Any]
    ) -> None:
        """Take a change of parameters. ``before``: all of the node's, before it; ``after``: the new ones."""
        self._unpaired[node].changes.append(_Change(stamp_ns, dict(before), after))
        self._pair(node)

    def as_values(self) -> list[dict[str, object]]:
        """Return the events, the oldest first."""
        return [event.as_values() for event in self._events]

    def _pair(self, node: str) -> None:
        """Give the node's events their changes: in order and by stamp, as either topic may be ahead."""
        events, changes = self._unpaired[node].events, self._unpaired[node].changes
        while events and changes:
            if events[0].stamp_ns < changes[0].stamp_ns:  # its counterpart was lost
                events.popleft()
            elif events[0].stamp_ns > changes[0].stamp_ns:
                changes.popleft()
            else:
                event, change = events.popleft(), changes.popleft()
                event.take(change.before, change.after)
                self._join_drag(event)

    def _join_drag(self, event: _Listed) -> None:
        """Let the event before go on to this one, if both belong to one drag."""
        place = next((i for i, other in enumerate(self._events) if other is event), 0)
        earlier = self._events[place - 1]
        if (
            place
            and event.after
            and earlier.node == event.node
            and earlier.after.keys() == event.after.keys()
            and abs(seconds(event.stamp_ns - earlier.stamp_ns)) <= _DRAG_S
        ):
            earlier.take(event.before, event.after)
            earlier.stamp_ns = event.stamp_ns
            del self._events[place]


@dataclass
class NodeSeen:
    """A node as its messages describe it; ``name``: without the run's namespace."""

    name: str
    state: str = "unconfigured"
    values: dict[str, Any] = field(default_factory=dict)
    health: Mapping[str, str] = field(default_factory=dict)
    kind: str = ""
    process: str = ""  # as `process_id` gives it
    _config: Any = None

    def say(self, values: Mapping[str, Any]) -> None:
        """Take the parameters that it reports."""
        self.values.update(values)
        self._config = self._built()

    def be(self, kind: str, process: str) -> None:
        """Take its kind, which may differ from its name, and its process."""
        self.kind, self.process = kind, process
        self._config = self._built()

    @property
    def config(self) -> Any:
        """Its configuration; None where that is not ours, not known yet, or not whole."""
        return self._config

    @property
    def config_class(self) -> type[Any] | None:
        """What it declares; None if it is none of ours, or its plant is not installed."""
        with suppress(KeyError, ParameterError):
            return config_class(self.kind or self.name, self.values)
        return None

    def _built(self) -> Any:
        config_class = self.config_class
        if config_class is None or not self.values:  # events can come before parameters
            return None
        declared = declarations(config_class)
        try:
            return build(config_class, {n: v for n, v in self.values.items() if n in declared})
        except ParameterError:
            return None


class Graph:
    """The nodes of one namespace; what changes is put on the board."""

    def __init__(self, board: Board, kept: int = _EVENTS) -> None:
        """``kept``: how many of the latest events the board has."""
        self.nodes: dict[str, NodeSeen] = {}
        self.started = self.ended = self.paused = False
        self._board = board
        self.events = EventList(kept)

    def node(self, name: str) -> NodeSeen:
        """Return a node; one that is not known yet is added."""
        return self.nodes.setdefault(name, NodeSeen(name))

    @property
    def simulator(self) -> SimulatorConfig:
        """The simulator's configuration; the default one until it is known."""
        config = self.nodes["simulator"].config if "simulator" in self.nodes else None
        return config if isinstance(config, SimulatorConfig) else TrunkSimulator()

    @property
    def controllers(self) -> list[str]:
        """The names of the controllers."""
        return [n.name for n in self.nodes.values() if isinstance(n.config, ControllerConfig)]

    def parameters(self, name: str, values: Mapping[str, Any]) -> None:
        """Take parameters that a node reports: all at start."""
        node = self.node(name)
        node.say(values)
        self._put_node(node)
        if name == "simulator":
            self._put_plant()
            for controller in self.controllers:  # whose units are its plant's
                self._put_node(self.nodes[controller])

    def change(self, name: str, stamp_ns: int, values: Mapping[str, Any]) -> None:
        """Take those that have changed; `put_events` shows it."""
        self.events.change(name, stamp_ns, self.node(name).values, values)
        self.parameters(name, values)

    def event(self, name: str, stamp_ns: int, message: str, values: Mapping[str, str]) -> None:
        """Take a run event; `put_events` shows it."""
        node = self.node(name)
        if message == Event.CONFIGURED:
            node.be(values.get("kind", ""), values.get("process", ""))
        for event, state in _STATES.items():
            if message == event:
                node.state = state
                self._put_node(node)
        if name == "simulator":
            self.started = self.started or message == Event.STARTED
            self.paused = (self.paused or message == Event.PAUSED) and message != Event.RESUMED
            self.ended = (self.ended or message in ENDS) and message != Event.STARTED
        self.events.add(name, stamp_ns, message, values)
        self.put_run()

    def put_events(self) -> None:
        """Put the latest events, and how many there were before them."""
        self._board.put("events", events=self.events.as_values(), before=self.events.dropped)

    def diagnosed(self, name: str, level: int, message: str, values: Mapping[str, str]) -> None:
        """Take what a node reports of its health, once a second."""
        node = self.node(name)
        node.health = dict(values)
        if values.get("lifecycle", node.state) != node.state:
            node.state = values["lifecycle"]
            self._put_node(node)
        self._board.put("health", name, level=level, message=message, values=node.health)

    def put_run(self) -> None:
        """Put what is known of the run as a whole."""
        acting = [name for name in self.controllers if self.nodes[name].state == "active"]
        self._board.put(
            "run", started=self.started, ended=self.ended, paused=self.paused, acting=acting
        )

    def _put_node(self, node: NodeSeen) -> None:
        declared = {} if node.config_class is None else declarations(node.config_class)
        self._board.put(
            "node",
            node.name,
            state=node.state,
            controller=isinstance(node.config, ControllerConfig),
            parameters={name: plain(value) for name, value in node.values.items()},
            terms=self._terms(node.config) if isinstance(node.config, ControllerConfig) else None,
            rules=_rule_base(node.config) if isinstance(node.config, RuleBaseConfig) else None,
        )
        self._board.put(
            "declared",
            node.name,
            parameters={
                name: self._declared(declared[name], node.config_class)
                for name in node.values
                if name in declared
            },
        )
        self.put_run()

    def _terms(self, config: ControllerConfig) -> dict[str, str]:
        """Return a law's terms with their units."""
        words = self.simulator.kind.of_drive
        law = law_of(config)
        units = {"unsaturated": "N m", **law.units}
        return {name: words(units.get(name, "")) for name in law.terms._fields}

    def _declared(self, declared: Declaration, config: type[Any] | None) -> dict[str, object]:
        controller = config is not None and issubclass(config, ControllerConfig)
        if controller:
            declared = self.simulator.kind.redeclared(declared, law=True)
        return {
            "law": controller and declared.name not in declarations(ControllerConfig),
            "kind": declared.kind,
            "unit": declared.unit,
            "description": declared.description,
            "allowed": declared.allowed(),
            "low": plain(declared.minimum if declared.minimum is not None else declared.above),
            "high": plain(declared.maximum),
            "choices": list(declared.choices),
            "fixed": declared.fixed,
            "unbounded": declared.unbounded,
            "default": plain(declared.default),
        }

    def _put_plant(self) -> None:
        config = self.nodes["simulator"].config
        if config is None and PLANT_NAME in self.nodes["simulator"].values:
            return  # that plant is not installed here
        config = self.simulator
        geometry = Geometry.from_parameters(values_of(config))
        self._board.put(
            "world",
            picture=as_data(geometry.picture),
            drive=geometry.drive,
            unit=config.kind.coordinates[0].unit,
            words=config.kind.page_words,
            limit=plain(config.max_effort),
            operator={"force": config.operator_force, "torque": config.operator_torque},
            lockstep=config.lockstep,
            rate=config.update_rate,
        )


def _rule_base(config: RuleBaseConfig) -> dict[str, object]:
    """Return the labels of a rule base: of e, of e_dot, and of each table."""
    return {
        **config.axes._asdict(),
        "tables": [
            {"name": f"rules.{table.name}", "title": table.title, "labels": list(table.centers)}
            for table in config.tables
        ],
    }
