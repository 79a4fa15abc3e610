"""A running node's parameters, read and set through its own services."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Any

import rclpy
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParametersAtomically,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from trunk_core.errors import LiveParametersError, did_you_mean
from trunk_core.parameters.declarations import unknown_name
from trunk_msgs_util.node import middleware

# Each client that DDS has to match takes time, so there are no others. A node discovers clients in
# the order of their creation: once it has answered the last one, it also knows the others.
_SERVICES = (SetParametersAtomically, ListParameters, DescribeParameters, GetParameters)
# A response sent before the server has matched the client is lost: after so long the request is repeated.
SET_AGAIN_S, _READ_AGAIN_S = 1.0, 0.1
_LOOK_S = 0.002  # there is no event for a discovered service


def _service(kind: Any) -> str:
    """Return the usual name of a kind of service: list_parameters for ListParameters."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in kind.__name__).lstrip("_")


class LiveParameters:
    """The parameters of one running node; a context manager that owns its ROS context."""

    def __init__(self, name: str, timeout_s: float, *kinds: Any) -> None:
        """Take the node's fully qualified name; each step may last ``timeout_s``.

        ``kinds`` of services can be asked, too.
        """
        self._name = name
        self.timeout_s = timeout_s
        middleware.prepare()
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(
            f"trunk_params_{time.monotonic_ns()}",
            context=self._context,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._clients = {
            kind: self._node.create_client(kind, f"{name}/{_service(kind)}")
            for kind in (*kinds, *_SERVICES)
        }

    def __enter__(self) -> LiveParameters:
        """Wait for the node. Raises LiveParametersError naming the nodes that are running instead."""
        try:
            self.ask(GetParameters)
            if self._names().count(self._name) > 1:
                raise LiveParametersError(f"several nodes are named {self._name}: stop all but one")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def names(self) -> list[str]:
        """Return the names of the node's parameters."""
        response = self.ask(ListParameters)
        return list(response.result.names)

    def values(self, names: Sequence[str]) -> dict[str, Any]:
        """Return current values by name. Raises LiveParametersError for names that the node does not have."""
        response = self.ask(GetParameters, names=list(names))
        if len(response.values) < len(names):
            self._refuse_unknown(names)
        values = (parameter_value_to_python(value) for value in response.values)
        return dict(zip(names, values, strict=True))

    def fixed(self, names: Sequence[str]) -> list[str]:
        """Return the parameters that are read-only."""
        response = self.ask(DescribeParameters, names=list(names))
        return [d.name for d in response.descriptors if d.read_only]

    def set_together(self, values: Mapping[str, Any]) -> None:
        """Set all values or none, in one call. Raises LiveParametersError with the node's reason."""
        parameters = []
        for name, value in values.items():
            try:
                parameters.append(Parameter(name, value=value).to_parameter_msg())
            except (TypeError, ValueError, AssertionError):
                raise LiveParametersError(
                    f"{self._name}: parameter {name!r}: {value!r} cannot be the value of a ROS 2 parameter"
                ) from None
        response = self.ask(SetParametersAtomically, SET_AGAIN_S, parameters=parameters)
        if not response.result.successful:
            raise LiveParametersError(f"{self._name} refuses: {response.result.reason}")

    def _refuse_unknown(self, names: Sequence[str]) -> None:
        known = self.names()
        reasons = "; ".join(
            f"parameter {name!r}: {unknown_name(name, known)}"
            for name in names
            if name not in known
        )
        raise LiveParametersError(f"{self._name}: {reasons or 'a parameter without a value'}")

    def _names(self) -> list[str]:
        return [n for n in self._node.get_fully_qualified_node_names() if n != self._own_name()]

    def _own_name(self) -> str:
        name: str = self._node.get_fully_qualified_name()
        return name

    def _absent(self) -> str:
        names = sorted(set(self._names()))
        if self._name in names:
            why = "it is busy, or its run has ended"
            return f"{self._name} does not answer within {self.timeout_s:g} s: {why}"
        there = ", ".join(names) or "none in this ROS domain"
        meant = did_you_mean(self._name, names)
        return f"no node {self._name} within {self.timeout_s:g} s; running nodes: {there}{meant}"

    def _until(self, condition: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + self.timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=_LOOK_S)
        return True

    def ask(self, kind: Any, again_s: float = _READ_AGAIN_S, **fields: Any) -> Any:
        """Return the node's answer. Raises LiveParametersError if there is none."""
        client = self._clients[kind]
        futures: list[Future] = []
        asked = -inf

        def answered() -> bool:
            nonlocal asked
            if time.monotonic() - asked > again_s and client.service_is_ready():
                asked = time.monotonic()
                futures.append(client.call_async(kind.Request(**fields)))
            return any(future.done() for future in futures)

        if not self._until(answered):
            raise LiveParametersError(self._absent())
        return next(future for future in futures if future.done()).result()
