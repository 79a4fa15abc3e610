"""Stands in for rclpy's C library: rclpy itself, and all nodes above it, run as they are, in a `World`.

`install` has to come before the first import of rclpy. What has nothing to do with the middleware (names,
serialization, quality of service, enumerations) is left to the real library.
"""

from __future__ import annotations

import re
import signal
import sys
import time
from collections import deque
from collections.abc import Callable
from itertools import count
from types import ModuleType, SimpleNamespace
from typing import Any

from .network import LATENCY_NS, Endpoint, Quality, Reader, Writer
from .world import Process, World

# The world that runs, handles, contexts, nodes and names.

_pointers = count(1)


class _State:
    """What the virtual library is built on; one world runs at a time."""

    world: World | None = None
    real: Any = None
    stepped_ns = 0


state = _State()


def world() -> World:
    """Return the world that runs."""
    assert state.world is not None
    return state.world


def real() -> Any:
    """Return the real library."""
    return state.real


def here() -> Process:
    """Return the process that runs."""
    assert world().current is not None
    return world().current


class Handle:
    """What all of the library's objects have."""

    def __init__(self) -> None:
        self.pointer = next(_pointers)
        self._destroyed = False

    def __enter__(self) -> Handle:
        if self._destroyed:
            raise real().InvalidHandle("destroyed")
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def destroy_when_not_in_use(self) -> None:
        if not self._destroyed:
            self._destroyed = True
            self.destroyed()

    def destroyed(self) -> None:
        """Let go of what it holds."""


class Context(Handle):
    def __init__(self, args: list[str], domain: int) -> None:
        super().__init__()
        self._ok = True
        process = here()
        process.context = self
        world().network.joined(process)

    def ok(self) -> bool:
        return self._ok

    def shutdown(self) -> None:
        self._ok = False

    def get_domain_id(self) -> int:
        return 0


class Node(Handle):
    def __init__(self, name: str, namespace: str, *_: Any) -> None:
        super().__init__()
        self.name = here().renamed.get("__node", name)
        self.namespace = here().renamed.get("__ns", namespace or "/")

    def logger_name(self) -> str:
        return self.get_fully_qualified_name()[1:].replace("/", ".")

    def get_node_name(self) -> str:
        return self.name

    def get_namespace(self) -> str:
        return self.namespace

    def get_fully_qualified_name(self) -> str:
        return f"{self.namespace.rstrip('/')}/{self.name}"

    def get_parameters(self, parameter: Any) -> dict[str, Any]:
        """Return the parameters that the command line gives this node."""
        given = here().parameters.get(self.name, here().parameters.get("*", {}))
        found = {
            name: parameter(name, getattr(parameter.Type, kind), value)
            for name, (kind, value) in given.items()
        }
        found["start_type_description_service"] = parameter(
            "start_type_description_service", value=False
        )
        return found

    def get_count_publishers(self, topic: str) -> int:
        return len(world().network.known_to(here(), Writer, topic))

    def get_count_subscribers(self, topic: str) -> int:
        return len(world().network.known_to(here(), Reader, topic))

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """Return one entry for each node of each process that is known."""
        known = {
            (end.process.number, *end.node)
            for end in (*world().network.writers, *world().network.readers)
            if here().number in end.known
        }
        return [(name, namespace) for _, name, namespace in sorted(known)]


def resolve(node: Node, name: str, only_expand: bool = False, service: bool = False) -> str:
    """Return a full name, as rcl expands it."""
    if name.startswith("/"):
        return name
    if name.startswith("~"):
        return node.get_fully_qualified_name() + name[1:]
    return f"{node.namespace.rstrip('/')}/{name}"


def type_name(kind: Any) -> str:
    return "/".join((*kind.__module__.split(".")[:2], kind.__name__))


def quality_of(profile: Any) -> Quality:
    told = profile.to_dict()
    return Quality(int(told["reliability"]), int(told["durability"]), int(told["depth"]))


# Publishers, subscriptions and services.

_SIZES = {"boolean": 1, "octet": 1, "char": 1, "uint8": 1, "int8": 1, "uint16": 2, "int16": 2,
          "uint32": 4, "int32": 4, "float": 4, "uint64": 8, "int64": 8, "double": 8}  # fmt: skip
_ARRAY = re.compile(r"(.*)\[(\d+)\]")


def wire_size(message: Any) -> int:
    """Return the length of a message in CDR, with the four bytes of encapsulation.

    rclpy's own ``serialize_message`` may return more than that: what follows the message has no meaning, and
    no fixed bytes.
    """
    return 4 + _message(0, message)


def _message(at: int, message: Any) -> int:
    for name, kind in message.get_fields_and_field_types().items():
        at = _value(at, kind, getattr(message, name))
    return at


def _value(at: int, kind: str, value: Any) -> int:
    if kind.startswith("sequence<"):
        inner = kind[len("sequence<") : -1].partition(",")[0]
        at = _aligned(at, 4) + 4
        return _many(at, inner, value)
    if fixed := _ARRAY.fullmatch(kind):
        return _many(at, fixed[1], value)
    if kind.startswith("string"):
        return _aligned(at, 4) + 4 + len(value.encode()) + 1
    if kind in _SIZES:
        return _aligned(at, _SIZES[kind]) + _SIZES[kind]
    return _message(at, value)


def _many(at: int, kind: str, values: Any) -> int:
    if kind in _SIZES:
        return _aligned(at, _SIZES[kind]) + _SIZES[kind] * len(values) if len(values) else at
    for value in values:
        at = _value(at, kind, value)
    return at


def _aligned(at: int, to: int) -> int:
    return -(-at // to) * to


class _Side(Handle):
    """A publisher or a subscription."""

    def __init__(
        self, join: Callable[..., Any], node: Node, kind: Any, topic: str, profile: Any
    ) -> None:
        super().__init__()
        name = resolve(node, topic)
        given = here(), (node.name, node.namespace), name, type_name(kind), quality_of(profile)
        self.endpoint: Any = join(*given)

    def get_topic_name(self) -> str:
        return str(self.endpoint.topic)

    def get_logger_name(self) -> str:
        return str(self.endpoint.node[0])

    def destroyed(self) -> None:
        world().network.remove(self.endpoint)


class Publisher(_Side):
    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        super().__init__(world().network.writer, node, kind, topic, profile)
        self.writer: Writer = self.endpoint

    def publish(self, message: Any) -> None:
        data = real().rclpy_serialize(message, type(message))
        self.publish_raw(data[: wire_size(message)])

    def publish_raw(self, data: bytes) -> None:
        world().network.publish(self.writer, bytes(data))

    def get_subscription_count(self) -> int:
        return len(self.writer.matched)

    def wait_for_all_acked(self, duration: Any) -> bool:
        """Let others run until all is received, or for the duration (below 0: however long)."""
        given_ns = int(duration.nanoseconds)
        end_ns = world().now_ns + (given_ns if given_ns >= 0 else 10**18)
        while not world().network.acknowledged(self.writer) and world().now_ns < end_ns:
            world().block(
                end_ns - world().now_ns, lambda: world().network.acknowledged(self.writer)
            )
        return world().network.acknowledged(self.writer)


class Subscription(_Side):
    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        super().__init__(world().network.reader, node, kind, topic, profile)
        self.reader: Reader = self.endpoint

    def take_message(self, kind: Any, raw: bool) -> tuple[Any, dict[str, int]] | None:
        """Return the oldest message and what is known of it, or None."""
        if not self.reader.queue:
            return None
        message = self.reader.queue.popleft()
        world().note("take", self.reader.process.name, self.reader.topic, message.number)
        data = message.data if raw else real().rclpy_deserialize(message.data, kind)
        info = {
            "source_timestamp": message.source_ns,
            "received_timestamp": world().now_ns,
            "publication_sequence_number": message.number,
            "reception_sequence_number": None,
        }
        return data, info  # type: ignore[return-value]

    def get_publisher_count(self) -> int:
        return len(self.reader.publishers)


class Service(Handle):
    """A service; its requests come from a client, or from the test itself."""

    def __init__(self, node: Node, kind: Any, name: str, profile: Any) -> None:
        super().__init__()
        self.name = resolve(node, name)
        self.kind, self.process = kind, here()
        self.qos = {"depth": 10}
        self.requests: deque[tuple[Any, Callable[[Any], None]]] = deque()
        services.setdefault(self.name, []).append(self)

    def ask(self, request: Any, answer: Callable[[Any], None]) -> None:
        """Let a request arrive."""
        self.requests.append((request, answer))
        world().nudge(self.process)

    def service_take_request(self, kind: Any) -> tuple[Any, Any] | tuple[None, None]:
        if not self.requests:
            return None, None
        request, answer = self.requests.popleft()
        return request, Header(answer)

    def service_send_response(self, response: Any, request_id: Header) -> None:
        request_id.answer(response)

    def get_logger_name(self) -> str:
        return self.name

    def destroyed(self) -> None:
        services[self.name].remove(self)


class Header:
    """Whose request it is."""

    def __init__(self, answer: Callable[[Any], None]) -> None:
        self.answer = answer
        self.request_id = self


services: dict[str, list[Service]] = {}


def _served(name: str) -> list[Service]:
    """Return the services of a name whose processes are known here."""
    ends = (*world().network.writers, *world().network.readers)
    known = {end.process.number for end in ends if here().number in end.known}
    return [one for one in services.get(name, []) if one.process.number in known]


class Client(Handle):
    def __init__(self, node: Node, kind: Any, name: str, profile: Any) -> None:
        super().__init__()
        self.name, self.process = resolve(node, name), here()
        self.answers: deque[tuple[Any, Any]] = deque()
        self._numbers = count(1)

    def service_server_is_available(self) -> bool:
        return bool(_served(self.name))

    def send_request(self, request: Any) -> int:
        """Ask: who answers has been told of the client, and so of all that its process had before it."""
        header = SimpleNamespace(sequence_number=next(self._numbers))

        def take(response: Any) -> None:
            self.answers.append((SimpleNamespace(request_id=header), response))
            world().nudge(self.process)

        def answer(response: Any) -> None:
            world().at(world().delay(*LATENCY_NS), lambda: take(response))

        for one in _served(self.name):
            wait_ns = world().network.until_known_ns(self.process, one.process)
            wait_ns += world().delay(*LATENCY_NS)
            world().at(wait_ns, lambda one=one: one.ask(request, answer))
        return header.sequence_number

    def take_response(self, kind: Any) -> tuple[Any, Any]:
        return self.answers.popleft() if self.answers else (None, None)


# Clocks, timers, guard conditions and wait sets.


class Clock(Handle):
    def __init__(self, clock_type: Any) -> None:
        super().__init__()
        self._type = int(clock_type)

    def get_now(self) -> Any:
        return real().rcl_time_point_t(world().look(), self._type)

    def get_ros_time_override_is_enabled(self) -> bool:
        return False

    def add_clock_callback(self, *_: Any) -> None:
        """Take a callback that no jump of time calls."""

    set_ros_time_override_is_enabled = set_ros_time_override = add_clock_callback
    remove_clock_callback = add_clock_callback


class Timer(Handle):
    def __init__(self, clock: Clock, context: Context, period_ns: int, autostart: bool) -> None:
        super().__init__()
        self.period_ns, self.canceled = int(period_ns), not autostart
        self.due_ns = world().now_ns + self.period_ns

    def is_timer_ready(self) -> bool:
        return not self.canceled and world().now_ns >= self.due_ns

    def call_timer(self) -> None:
        if self._destroyed:
            raise real().InvalidHandle("destroyed")
        self.due_ns += self.period_ns
        if self.due_ns < world().now_ns:  # what was missed is missed
            behind = (world().now_ns - self.due_ns) // max(self.period_ns, 1) + 1
            self.due_ns += behind * self.period_ns

    def cancel_timer(self) -> None:
        self.canceled = True

    def reset_timer(self) -> None:
        self.canceled = False
        self.due_ns = world().now_ns + self.period_ns

    def is_timer_canceled(self) -> bool:
        return self.canceled

    def change_timer_period(self, period_ns: int) -> None:
        self.period_ns = int(period_ns)

    def get_timer_period(self) -> int:
        return self.period_ns

    def time_until_next_call(self) -> int:
        return self.due_ns - world().now_ns


class GuardCondition(Handle):
    def __init__(self, context: Context) -> None:
        super().__init__()
        self.triggered = False

    def trigger_guard_condition(self) -> None:
        self.triggered = True


class EventHandle(Handle):
    """An event of the middleware; none happens here."""

    def __init__(self, parent: Handle, kind: Any) -> None:
        super().__init__()


class WaitSet(Handle):
    def __init__(self, *_: Any) -> None:
        super().__init__()
        self._kinds: dict[str, list[Any]] = {}
        self._ready: dict[str, list[int]] = {}

    def clear_entities(self) -> None:
        self._kinds = {
            kind: [] for kind in ("subscription", "timer", "guard_condition", "service", "client")
        }

    def _add(self, kind: str, handle: Handle) -> int:
        with handle:
            self._kinds[kind].append(handle)
        return len(self._kinds[kind]) - 1

    def add_subscription(self, handle: Handle) -> int:
        return self._add("subscription", handle)

    def add_timer(self, handle: Handle) -> int:
        return self._add("timer", handle)

    def add_guard_condition(self, handle: Handle) -> int:
        return self._add("guard_condition", handle)

    def add_service(self, handle: Handle) -> int:
        return self._add("service", handle)

    def add_client(self, handle: Handle) -> int:
        return self._add("client", handle)

    def add_event(self, handle: Handle) -> int:
        return 0

    def is_ready(self, kind: str, index: int) -> bool:
        return False

    def _look(self) -> dict[str, list[int]]:
        kinds = self._kinds
        return {
            "subscription": [s.pointer for s in kinds["subscription"] if s.reader.queue],
            "timer": [t.pointer for t in kinds["timer"] if t.is_timer_ready()],
            "guard_condition": [g.pointer for g in kinds["guard_condition"] if g.triggered],
            "service": [s.pointer for s in kinds["service"] if s.requests],
            "client": [c.pointer for c in kinds["client"] if c.answers],
        }

    def wait(self, limit_ns: int) -> None:
        """Wait until something is ready, or for a time; below 0 for ever."""
        found = self._look()
        if limit_ns and not any(found.values()):
            left = [t.time_until_next_call() for t in self._kinds["timer"] if not t.canceled]
            if left:
                soonest = max(min(left), 1)
                limit_ns = soonest if limit_ns < 0 else min(limit_ns, soonest)
            world().block(limit_ns, lambda: any(self._look().values()))
            found = self._look()
        for guard in self._kinds["guard_condition"]:
            guard.triggered = False
        self._ready = found

    def get_ready_entities(self, kind: str) -> list[int]:
        return self._ready.get(kind, [])


# ROS 2's lifecycle.

_STATES = {1: "unconfigured", 2: "inactive", 3: "active", 4: "finalized", 10: "configuring",
           11: "cleaningup", 12: "shuttingdown", 13: "activating", 14: "deactivating",
           15: "errorprocessing"}  # fmt: skip
# (state, transition's id, label, next state), as ROS 2's design has them.
_GRAPH = [
    (1, 1, "configure", 10), (2, 2, "cleanup", 11), (2, 3, "activate", 13),
    (3, 4, "deactivate", 14), (1, 5, "shutdown", 12), (2, 6, "shutdown", 12),
    (3, 7, "shutdown", 12),
    *((state, 10 * state + i, f"transition_{word}", then)
      for state, ends in ((10, (2, 1, 15)), (11, (1, 2, 15)), (12, (4, 4, 15)),
                          (13, (3, 2, 15)), (14, (2, 3, 15)), (15, (1, 4, 4)))
      for i, (word, then) in enumerate(zip(("success", "failure", "error"), ends, strict=True))),
]  # fmt: skip


class LifecycleStateMachine(Handle):
    def __init__(self, node: Node, communicates: bool) -> None:
        super().__init__()
        self.initialized = True
        self._state = 1
        for name in ("change_state", "get_state", "get_available_states",
                     "get_available_transitions", "get_transition_graph"):  # fmt: skip
            setattr(self, f"service_{name}", Service(node, None, f"~/{name}", None))

    @property
    def current_state(self) -> tuple[int, str]:
        return self._state, _STATES[self._state]

    @property
    def available_states(self) -> list[tuple[int, str]]:
        return list(_STATES.items())

    @property
    def transition_graph(self) -> list[tuple[int, str, int, str, int, str]]:
        return [(number, label, a, _STATES[a], b, _STATES[b]) for a, number, label, b in _GRAPH]

    @property
    def available_transitions(self) -> list[tuple[int, str, int, str, int, str]]:
        return [transition for transition in self.transition_graph if transition[2] == self._state]

    def get_transition_by_label(self, label: str) -> int:
        for number, known, *_ in self.available_transitions:
            if known == label:
                return number
        raise real().RCLError(f"no transition {label!r} from {_STATES[self._state]}")

    def trigger_transition_by_id(self, number: int, publish: bool) -> None:
        for known, _, _, _, after, _ in self.available_transitions:
            if known == number:
                self._state = after
                return
        raise real().RCLError(f"no transition {number} from {_STATES[self._state]}")

    def trigger_transition_by_label(self, label: str, publish: bool) -> None:
        self.trigger_transition_by_id(self.get_transition_by_label(label), publish)


# The library.


def _infos(node: Node, topic: str, kind: type[Endpoint]) -> list[dict[str, Any]]:
    """Return what the process knows of a topic's endpoints, whose nodes may have no known name yet."""
    found = []
    for end in world().network.known_to(here(), kind, resolve(node, topic)):
        named = here().number in end.named
        name, namespace = end.node if named else ("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_")
        found.append(
            {
                "node_name": name,
                "node_namespace": namespace,
                "topic_type": end.type,
                "endpoint_type": 1 if kind is Writer else 2,
                "endpoint_gid": list(end.number.to_bytes(16, "little")),
                "qos_profile": {
                    "history": 1,
                    "depth": end.quality.depth,
                    "reliability": end.quality.reliability,
                    "durability": end.quality.durability,
                },
            }
        )
    return found


def _names_and_types(node: Node, *_: Any) -> list[tuple[str, list[str]]]:
    found: dict[str, set[str]] = {}
    for end in (*world().network.writers, *world().network.readers):
        if here().number in end.known:
            found.setdefault(end.topic, set()).add(end.type)
    return [(topic, sorted(types)) for topic, types in sorted(found.items())]


def _log(severity: Any, name: str, message: str, *_: Any) -> None:
    if world().current is not None:
        world().current.log.append(f"{name}: {message}")


class _Library(ModuleType):
    """The real library, but for what is virtual."""

    def __init__(self, library: Any) -> None:
        super().__init__(library.__name__)
        self._library = library
        nothing = lambda *_, **__: None  # noqa: E731
        self.__dict__.update(
            {kind.__name__: kind for kind in (
                Context, Node, Publisher, Subscription, Service, Client, Clock, Timer, GuardCondition,
                EventHandle, WaitSet, LifecycleStateMachine)},
            rmw_service_info_t=Header,
            rmw_request_id_t=Header,
            rclpy_resolve_name=resolve,
            rclpy_remap_topic_name=lambda node, name: name,
            rclpy_get_publishers_info_by_topic=lambda node, topic, *_: _infos(node, topic, Writer),
            rclpy_get_subscriptions_info_by_topic=lambda node, topic, *_: _infos(node, topic, Reader),
            rclpy_get_topic_names_and_types=_names_and_types,
            rclpy_get_service_names_and_types=lambda node: [(n, [""]) for n in services if _served(n)],
            rclpy_logging_configure=nothing,
            rclpy_logging_fini=nothing,
            rclpy_logging_rcutils_log=_log,
            rclpy_logging_rosout_add_sublogger=nothing,
            install_signal_handlers=nothing,
            uninstall_signal_handlers=nothing,
            register_sigint_guard_condition=nothing,
            unregister_sigint_guard_condition=nothing,
        )  # fmt: skip

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name)


def install() -> None:
    """Put the virtual library below rclpy, and virtual time and signals below everything."""
    import rpyutils

    load = rpyutils.import_c_library

    def import_c_library(name: str, package: str | None = None) -> Any:
        found = load(name, package)
        if name == "._rclpy_pybind11" and package == "rclpy":
            state.real = found
            return _Library(found)
        return found

    rpyutils.import_c_library = import_c_library
    assert "rclpy" not in sys.modules
    for name, of_world in {
        "monotonic": lambda now: now / 1e9,
        "monotonic_ns": lambda now: now,
        "time": lambda now: 1.7e9 + (now + state.stepped_ns) / 1e9,
        "time_ns": lambda now: 1_700_000_000_000_000_000 + now + state.stepped_ns,
    }.items():
        _virtual(name, of_world)
    sleep = time.sleep

    def virtual_sleep(seconds: float) -> None:
        if _runs():
            world().block(max(round(seconds * 1e9), 1))
        else:
            sleep(seconds)

    time.sleep = virtual_sleep
    set_handler = signal.signal

    def virtual_signal(number: int, handler: Any) -> Any:
        if not _runs() or number not in (signal.SIGINT, signal.SIGTERM):
            return set_handler(number, handler)
        here().handlers[int(number)] = handler
        while int(number) in here().pending:
            here().pending.remove(int(number))
            handler(int(number), None)
        return None

    signal.signal = virtual_signal  # type: ignore[assignment]


def step_clock(by_ns: int) -> None:
    """Set the wall clock forward or back; the steady clock stays."""
    state.stepped_ns += by_ns


def _runs() -> bool:
    return state.world is not None and state.world.current is not None


def _virtual(name: str, of_world: Callable[[int], Any]) -> None:
    own = getattr(time, name)
    setattr(time, name, lambda: of_world(world().look()) if _runs() else own())
