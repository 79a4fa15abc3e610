"""What the virtual library is built on: the world that runs, handles, contexts, nodes and names."""

from __future__ import annotations

from itertools import count
from typing import Any

from .network import Quality, Reader, Writer
from .world import Process, World

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
        self.name, self.namespace = name, namespace or "/"

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
        given = here().parameters.get(self.name, {})
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
            (one.process.number, *one.node)
            for one in (*world().network.writers, *world().network.readers)
            if here().number in one.known
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
