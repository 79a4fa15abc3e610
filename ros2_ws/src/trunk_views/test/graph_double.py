"""A running graph for the page, without any node: what a page asks for is done at once."""

import asyncio
import threading
from collections.abc import Callable
from queue import SimpleQueue

import numpy as np

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.pid import PidConfig
from trunk_core.parameters.declarations import ParameterError, build, values_of
from trunk_sim.config import TrunkSimulator
from trunk_views.live.feed import (
    PLANT,
    PLANT_COLUMNS,
    Board,
    RefusedRequestError,
    StreamRows,
    columns_of,
    put_stream,
    with_rules,
)
from trunk_views.live.graph_state import Graph

from .gateway_served import Served

TERMS = ("reference", "measurement", "error", "error_rate", "kp", "ki", "kd", "alpha")
TERMS += ("p_term", "i_term", "d_term", "effort")
PERIOD_S = 0.02


class GraphDouble:
    """Two controllers, a plant, and rows of both as far as the test lets time go on."""

    def __init__(self) -> None:
        self.board, self.streams = Board(), []
        self.graph = Graph(self.board)
        self.calls: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self.t = 0.0
        fuzzy = FuzzyPidConfig()
        put_stream(self.board, self.streams, PLANT, StreamRows(PLANT_COLUMNS, 10_000))
        columns = columns_of("fuzzy_pid", TERMS, fuzzy)
        put_stream(self.board, self.streams, "fuzzy_pid", StreamRows(columns, 10_000))
        for name, config in (
            ("pid", PidConfig()),
            ("simulator", TrunkSimulator(operator_torque=40.0, lockstep=True)),
            ("fuzzy_pid", fuzzy),
        ):
            self.graph.parameters(name, values_of(config))
        self.event("fuzzy_pid", "activated")
        self.event("simulator", "started", rate="200")
        self.go(2.0)

    def event(self, node: str, message: str, **values: str) -> None:
        """Report an event now."""
        self.graph.event(node, round(self.t * 1e9), message, values)
        self.graph.put_events()

    def go(self, to: float) -> None:
        """Add rows up to a time."""
        config = self.graph.nodes["fuzzy_pid"].config
        while self.t < to:
            angle, rate = 0.3 * np.cos(self.t), -0.3 * np.sin(self.t)
            torque = -40 * angle - 10 * rate
            self.streams[0].rows.add((self.t, 0.1 * self.t, angle, 0.1, rate, torque))
            terms = (0.0, angle, -angle, -rate, 50.0, 70.0, 15.0, 3.0, -50 * angle, 0.0, -15 * rate)
            row = with_rules((self.t, *terms, torque), TERMS, config)
            self.streams[1].rows.add(row)
            self.t += PERIOD_S

    def turn(self) -> None:
        while not self.calls.empty():
            self.calls.get()()

    async def begin(self) -> None: ...

    async def ask(self, client, asked):
        values = asked.values
        if asked.kind == "set":
            node = self.graph.nodes[values["node"]]
            try:
                build(node.config_class, {**node.values, **values["values"]})
            except ParameterError as error:
                raise RefusedRequestError(f"{node.name}: {error}") from None
            self.graph.parameters(node.name, values["values"])
        elif asked.kind == "swap":
            for name in self.graph.controllers:
                self.event(name, "activated" if name == values["to"] else "deactivated")
        return "done"

    def close(self) -> None: ...


class ServedGraph:
    """The double behind a gateway that serves in a thread of its own."""

    def __init__(self) -> None:
        self.graph = GraphDouble()
        self._loop = asyncio.new_event_loop()
        ready = threading.Event()

        async def serve() -> None:
            self._over = asyncio.Event()
            served = Served(stoppable=True, feed=self.graph)
            self.gateway = served.gateway
            self.address = f"http://127.0.0.1:{served.port}/#{served.tokens.control}"
            ready.set()
            await self._over.wait()
            await served.close()

        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(serve()))
        self._thread.start()
        ready.wait()

    def call(self, function: Callable[..., object], *given: object, **values: str) -> None:
        """Call a function of the double in the gateway's thread."""
        self.graph.calls.put(lambda: function(*given, **values))

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()
        self._loop.close()
