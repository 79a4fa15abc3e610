"""``trunk params`` on running nodes, and what their parameters are then."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from .peer import Peer
from .processes import PATIENT, Children

Verb = Callable[..., tuple[int, list[str], list[str]]]


def params(children: Children, verb: str) -> Verb:
    """Return a function that runs ``trunk params VERB``: exit code, lines on stdout, lines on stderr."""
    numbers = count()

    def run(*arguments: object) -> tuple[int, list[str], list[str]]:
        # Of two limits the last counts.
        name = f"{verb}-{next(numbers)}"
        child = children.trunk("params", verb, *PATIENT, *arguments, name=name)
        code = child.wait()
        assert "Traceback" not in child.stderr
        return code, child.stdout.splitlines(), child.stderr.splitlines()

    return run


def values(peer: Peer, node: str, *names: str) -> list[object]:
    """Return a node's parameters of these names."""
    response = peer.call(GetParameters, f"/{node.lstrip('/')}/get_parameters", names=names)
    return [parameter_value_to_python(value) for value in response.values]
