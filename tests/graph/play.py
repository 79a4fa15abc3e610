"""The nodes of a plan as real processes, and what is still to be done to them, each thing at its time."""

import signal
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.client import Client

from ..seeds.story import Request
from .peer import Peer
from .processes import Child, Children

_ASK_AGAIN_S = 0.05


class Play:
    """Processes by the node's name, each with all that were started one after the other."""

    def __init__(
        self, children: Children, peer: Peer, folder: Path, recording: str = "run.mcap"
    ) -> None:
        """The plan's parameters are in ``params.yaml`` of the folder."""
        self.folder, self.path = folder, folder / recording
        self.processes: dict[str, list[Child]] = defaultdict(list)
        self._children, self._peer = children, peer
        self._due: list[tuple[float, Callable[[], object]]] = []
        self._clients: dict[str, Client] = {}

    def after(self, wait_s: float, action: Callable[[], object]) -> None:
        self._due.append((time.monotonic() + wait_s, action))

    def act(self) -> None:
        """Do what is due by now."""
        now = time.monotonic()
        for entry in [entry for entry in self._due if entry[0] <= now]:
            self._due.remove(entry)
            entry[1]()

    def alive(self, name: str) -> bool:
        return any(child.alive for child in self.processes[name])

    def start(self, name: str, file: str = "params.yaml") -> Child:
        given: list[object] = ["--params-file", self.folder / file]
        given += [f"output:={self.path}"] if name == "recorder" else []
        begun = self.processes[name]
        begun.append(self._children.node(name, *given, name=f"{name}_{len(begun)}"))
        return begun[-1]

    def strike(self, kind: str, node: str, value: float, again: Callable[[], object]) -> None:
        """Stall a node's process for a time, stop or kill it, or begin it ``again`` a time later."""
        child = next((child for child in self.processes[node] if child.alive), None)
        if child is None:
            return
        if kind == "stall":
            child.send(signal.SIGSTOP)
            self.after(value, partial(child.send, signal.SIGCONT))
        elif kind == "stop":
            child.send(signal.SIGINT)
        else:
            child.send(signal.SIGKILL)
            if kind == "restart":
                self.after(value, again)

    def prepare(self, request: Request) -> None:
        """Look for a service before it is asked for."""
        if request.service not in self._clients:
            found = self._peer.node.create_client(request.kind, request.service)
            self._clients[request.service] = found

    def ask(self, request: Request) -> Any:
        """Call a service, whose node may be stalled or dying; return the call, None if that is not there."""
        client = self._clients[request.service]
        if not client.service_is_ready():
            if self.alive(request.service.split("/")[1]) and self.alive("simulator"):
                self.after(_ASK_AGAIN_S, partial(self.ask, request))
            return None
        return client.call_async(request.kind.Request(**request.fields))

    def wait(self, condition: Callable[[], object], purpose: str) -> None:
        self._peer.until(condition, purpose)

    def end(self, order: Iterable[Iterable[str]]) -> None:
        """End what is left, as by Ctrl-C: these nodes, and then those."""
        self._due.clear()
        for names in order:
            left = [child for name in names for child in self.processes[name]]
            for child in left:
                child.send(signal.SIGCONT)  # to what is still stopped
                child.send(signal.SIGINT)
            ends = ", ".join(child.name for child in left)
            self.wait(lambda left=left: not any(child.alive for child in left), f"{ends} end")
