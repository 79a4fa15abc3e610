"""A node's lifecycle and parameters, by its services."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
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
    """The services of one node."""

    def __init__(self, peer: Peer, node: str) -> None:
        self._peer = peer
        self._node = node

    def _call(self, kind: type, service: str, **fields: Any) -> Any:
        return self._peer.call(kind, f"/{self._node}/{service}", **fields)

    # Parameters.

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

    # Lifecycle.

    def state(self) -> str:
        label: str = self._call(GetState, "get_state").current_state.label
        return label

    def change(self, label: str) -> bool:
        """Ask for a transition by its number, as ``ros2 lifecycle set`` does."""
        request = Transition(id=getattr(Transition, f"TRANSITION_{label.upper()}"))
        success: bool = self._call(ChangeState, "change_state", transition=request).success
        return success

    def available(self) -> set[str]:
        found = self._call(GetAvailableTransitions, "get_available_transitions")
        return {f.transition.label for f in found.available_transitions}


def _messages(values: dict[str, Any]) -> list[Any]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
