"""The parameter services of a node, called by the test's own."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter, parameter_value_to_python

from .peer import Peer


class Services:
    """The parameter services of one node."""

    def __init__(self, peer: Peer, node: str) -> None:
        self._peer = peer
        self._node = node

    def set(self, **values: Any) -> SetParametersResult:
        """Set parameters one by one; ``__`` in a name stands for the dot. Return the last result."""
        return self.set_each(**values)[-1]

    def set_each(self, **values: Any) -> list[SetParametersResult]:
        response = self._call(SetParameters, "set_parameters", parameters=_messages(values))
        return response.results

    def set_together(self, **values: Any) -> SetParametersResult:
        return self._call(
            SetParametersAtomically, "set_parameters_atomically", parameters=_messages(values)
        ).result

    def get(self, *names: str) -> list[Any]:
        values = self._call(GetParameters, "get_parameters", names=names).values
        return [parameter_value_to_python(value) for value in values]

    def describe(self, *names: str) -> Any:
        return self._call(DescribeParameters, "describe_parameters", names=names).descriptors

    def _call(self, kind: type, service: str, **fields: Any) -> Any:
        return self._peer.call(kind, f"/{self._node}/{service}", **fields)


def _messages(values: dict[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
