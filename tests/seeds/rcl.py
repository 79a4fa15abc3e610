"""Stands in for rclpy's C library: rclpy itself, and all nodes above it, run as they are, in a `World`.

`install` has to come before the first import of rclpy. What has nothing to do with the middleware (names,
serialization, quality of service, enumerations) is left to the real library.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

from .base import Context, Node, here, resolve, state, world
from .endpoints import Header, Publisher, Service, Subscription, services
from .lifecycle import LifecycleStateMachine
from .network import Endpoint, Reader, Writer
from .waiting import Clock, EventHandle, GuardCondition, Timer, WaitSet

__all__ = ["here", "install", "services", "state", "step_clock", "world"]


def _infos(node: Node, topic: str, kind: type[Endpoint]) -> list[dict[str, Any]]:
    """Return what the process knows of a topic's endpoints, whose nodes may have no known name yet."""
    found = []
    for one in world().network.known_to(here(), kind, resolve(node, topic)):
        named = here().number in one.named
        name, namespace = one.node if named else ("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_")
        found.append(
            {
                "node_name": name,
                "node_namespace": namespace,
                "topic_type": one.type,
                "endpoint_type": 1 if kind is Writer else 2,
                "endpoint_gid": list(one.number.to_bytes(16, "little")),
                "qos_profile": {
                    "history": 1,
                    "depth": one.quality.depth,
                    "reliability": one.quality.reliability,
                    "durability": one.quality.durability,
                },
            }
        )
    return found


def _names_and_types(node: Node, *_: Any) -> list[tuple[str, list[str]]]:
    found: dict[str, set[str]] = {}
    for one in (*world().network.writers, *world().network.readers):
        if here().number in one.known:
            found.setdefault(one.topic, set()).add(one.type)
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
            {one.__name__: one for one in (
                Context, Node, Publisher, Subscription, Service, Clock, Timer, GuardCondition,
                EventHandle, WaitSet, LifecycleStateMachine)},
            rmw_service_info_t=Header,
            rmw_request_id_t=Header,
            rclpy_resolve_name=resolve,
            rclpy_remap_topic_name=lambda node, name: name,
            rclpy_get_publishers_info_by_topic=lambda node, topic, *_: _infos(node, topic, Writer),
            rclpy_get_subscriptions_info_by_topic=lambda node, topic, *_: _infos(node, topic, Reader),
            rclpy_get_topic_names_and_types=_names_and_types,
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
        if not _runs():
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
