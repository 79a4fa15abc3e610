"""A trial with real processes over DDS: they are started, disturbed, and ended as somebody would by hand."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.client import Client
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.conversions import sample_to_ros
from trunk_msgs_util.samples import JointSample

from ..graph.peer import Peer
from ..graph.processes import Child, Children
from .trial import Incident, Trial

_TRANSITIONS = ("configure", "activate", "deactivate")
_STRANGER = Path(__file__).with_name("stranger.py")
_ASK_AGAIN_S = 0.05
_LATE = 10.0  # times its own duration a run may take on a busy machine, before it is stopped
_HUNG_S = 300.0  # until what was told to end counts as hung
# Of the factor on an ending node's wait for its recorder: a busy machine may hold the recorder up.
PATIENCE = "20"


class HungError(Exception):
    """A process that did not begin, or did not end."""


class Play:
    """The processes of a trial, and what is still to be done to them."""

    def __init__(self, trial: Trial, children: Children, peer: Peer, folder: Path) -> None:
        self.trial = trial
        self.changes: dict[str, list[Mapping[str, Any]]] = defaultdict(list)  # accepted, by node
        self.processes: dict[str, list[Child]] = defaultdict(list)
        self._folder = folder
        self._children, self._peer = children, peer
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._calls: list[Any] = []
        self._clients: dict[str, Client] = {}
        self._publishers: dict[str, Any] = {}
        touched = {(i.kind, i.node) for i in trial.incidents}
        without = bool(touched & {("kill", "recorder"), ("stop", "recorder")})
        os.environ["TRUNK_PATIENCE"] = "1" if without else PATIENCE

    def play(self) -> None:
        """Play it, then end all that is left. Raises HungError."""
        for incident in self.trial.incidents:  # discovered before the run begins
            self._prepare(incident)
        plan = self.trial.plan()
        plan.write_parameters(self._folder / "params.yaml")
        for name in plan.configs:
            if name not in self.trial.absent:
                self._start(name)
        if "stranger instead" in self.trial.kinds:
            self._start_stranger(0.5)
        self._wait(self._begun, "the run begins")
        now = time.monotonic()
        for incident in self.trial.incidents:
            self._due.append((now + incident.at_s, partial(self._strike, incident)))
        patience_s = _LATE * self.trial.duration + 10.0
        self._peer.until(
            lambda: self._over() or time.monotonic() > now + patience_s, "the run is over"
        )
        self._due.clear()
        self._end()

    def complaints(self) -> list[str]:
        """Return our nodes that ended as none should."""
        lines = []
        for name, children in self.processes.items():
            for child in children if name != "stranger" else ():
                code, text = child.process.returncode, child.stderr
                if "Traceback" in text or code not in (0, 1, -signal.SIGKILL):
                    last = text.strip().splitlines()[-1:]
                    lines.append(f"{name} ended with {code}: {' '.join(last)}")
        return lines

    # Its course.

    def _begun(self) -> bool:
        started = any(e.message == "started" for e in self._peer.events)
        return started or not self._alive("simulator")

    def _over(self) -> bool:
        now = time.monotonic()
        for entry in [entry for entry in self._due if entry[0] <= now]:
            self._due.remove(entry)
            entry[1]()
        return not self._due and not self._alive("simulator")

    def _alive(self, name: str) -> bool:
        return any(child.process.poll() is None for child in self.processes[name])

    def _wait(self, condition: Callable[[], bool], purpose: str) -> None:
        deadline = time.monotonic() + _HUNG_S
        self._peer.until(lambda: condition() or time.monotonic() > deadline, purpose)
        if not condition():
            raise HungError(f"waited in vain: {purpose}")

    def _end(self) -> None:
        """End what is left, as by Ctrl-C: the simulator first, the recorder last or earlier."""
        others = [name for name in self.processes if name not in ("simulator", "recorder")]
        order = [["simulator"], others, ["recorder"]]
        if not self.trial.recorder_last:
            order = [["simulator"], ["recorder"], others]
        for names in order:
            left = [child for name in names for child in self.processes[name]]
            for child in left:
                child.send(signal.SIGCONT)
                child.send(signal.SIGINT)
            self._wait(partial(_ended, left), f"{', '.join(names)} end")

    # What is done.

    def _prepare(self, incident: Incident) -> None:
        kind, node = incident.kind, f"/{incident.node}"
        if incident.held:
            self._client("/simulator/pause", SetBool)
        create = self._peer.node.create_publisher
        if kind in _TRANSITIONS:
            self._client(f"{node}/change_state", ChangeState)
        elif kind == "retune":
            self._client(f"{node}/set_parameters_atomically", SetParametersAtomically)
        elif kind == "reset":
            self._client(f"{node}/reset", Trigger)
        elif kind == "pause":
            self._client(f"{node}/pause", SetBool)
        elif kind == "push" and kind not in self._publishers:
            self._publishers[kind] = create(
                JointState, f"/{topics.OPERATOR_REQUEST}", qos.control()
            )
        elif kind == "refer" and kind not in self._publishers:
            self._publishers[kind] = create(JointState, node, 10)

    def _client(self, service: str, kind: type) -> None:
        if service not in self._clients:
            self._clients[service] = self._peer.node.create_client(kind, service)

    def _strike(self, incident: Incident) -> None:
        kind, node, value = incident.kind, incident.node, incident.value
        if kind in _TRANSITIONS:
            number = getattr(Transition, f"TRANSITION_{kind.upper()}")
            request = ChangeState.Request(transition=Transition(id=number))
            self._ask(f"/{node}/change_state", request)
        elif kind == "reset":
            self._ask(f"/{node}/reset", Trigger.Request())
        elif kind == "pause":
            self._ask(f"/{node}/pause", SetBool.Request(data=value))
        elif kind == "retune":
            self._retune(node, value)
        elif kind == "push":
            message = JointState(name=["hip", "trunk"], effort=[0.0, value])
            message.header.frame_id = "somebody"
            self._publishers[kind].publish(message)
        elif kind == "refer":
            self._publishers[kind].publish(
                sample_to_ros(JointSample(0, ("trunk",), position=(value,)))
            )
        elif kind == "mistype":
            publisher = self._peer.node.create_publisher(Float64, f"/{node}", 10)
            publisher.publish(Float64(data=1.0))
        elif kind == "stranger":
            self._held(incident, partial(self._start_stranger, value))
        elif kind in ("begin", "namesake"):
            self._held(incident, partial(self._start, node))
        else:
            self._signal(incident)

    def _signal(self, incident: Incident) -> None:
        _, kind, node, value, _ = incident
        child = next((c for c in self.processes[node] if c.process.poll() is None), None)
        if child is None:
            return
        if kind == "stall":
            child.send(signal.SIGSTOP)
            self._due.append((time.monotonic() + value, partial(child.send, signal.SIGCONT)))
        elif kind == "stop":
            child.send(signal.SIGINT)
        else:
            child.send(signal.SIGKILL)
            self.changes.pop(node, None)
            if kind == "restart":
                start = partial(self._held, incident, partial(self._start, node))
                self._due.append((time.monotonic() + value, start))

    def _held(self, incident: Incident, start: Callable[[], Child]) -> None:
        """Start a process; the plant is paused meanwhile, if it is to be: a busy machine takes its time."""
        before = self._signs(incident.node)
        if incident.held:
            self._ask("/simulator/pause", SetBool.Request(data=True))
        child = start()
        if incident.held:
            self._resume(child, incident.node, before)

    def _resume(self, child: Child, node: str, before: int) -> None:
        """Let the plant go on once a process that was started acts, or has ended."""
        if child.process.poll() is None and self._signs(node) == before:
            again = partial(self._resume, child, node, before)
            self._due.append((time.monotonic() + _ASK_AGAIN_S, again))
        else:
            self._ask("/simulator/pause", SetBool.Request(data=False))

    def _signs(self, node: str) -> int:
        """Return how often a node was activated; without a name: how many give commands."""
        if not node:
            return self._peer.node.count_publishers(f"/{topics.EFFORT_COMMAND}")
        return [event[:2] for event in self._peer.events].count((f"/{node}", Event.ACTIVATED))

    def _ask(self, service: str, request: Any) -> Any:
        """Call a service without waiting for the answer; return the call, None if nobody is there yet."""
        client = self._clients[service]
        if not client.service_is_ready():
            if self._alive(service.split("/")[1]) and self._alive("simulator"):
                self._due.append(
                    (time.monotonic() + _ASK_AGAIN_S, partial(self._ask, service, request))
                )
            return None
        call = client.call_async(request)
        self._calls.append(call)
        return call

    def _retune(self, node: str, values: Mapping[str, Any]) -> None:
        parameters = [
            Parameter(name, value=list(v) if isinstance(v, tuple) else v)
            for name, v in values.items()
        ]
        request = SetParametersAtomically.Request(
            parameters=[parameter.to_parameter_msg() for parameter in parameters]
        )
        call = self._ask(f"/{node}/set_parameters_atomically", request)
        if call is not None:
            call.add_done_callback(lambda done: self._accept(node, values, done.result()))

    def _accept(self, node: str, values: Mapping[str, Any], response: Any) -> None:
        """Remember a change that was made while the run went on, by a node that was not killed since."""
        ended = any(e.message == "finished" for e in self._peer.events)
        if response is not None and response.result.successful and not ended:
            self.changes[node].append(values)

    def _start(self, name: str) -> Child:
        children = self.processes[name]
        given: list[object] = ["--params-file", self._folder / "params.yaml"]
        if name == "recorder":
            given.append(f"output:={self._folder / 'run.mcap'}")
        children.append(self._children.node(name, *given, name=f"{name}_{len(children)}"))
        return children[-1]

    def _start_stranger(self, gain: float) -> Child:
        frame = self._folder.name if self.trial.seed % 2 else ""
        child = self._children.start("stranger", sys.executable, _STRANGER, gain, frame)
        self.processes["stranger"].append(child)
        return child


def _ended(children: Iterable[Child]) -> bool:
    return all(child.process.poll() is not None for child in children)
