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


def line_without(verb: Verb, node: str, *arguments: object) -> str:
    """Return the line about a node that is not there, where others are.

    It may find no node at all if one was held up for as long as it waits: then it waits twice as long.
    """
    limit_s = 3
    while True:
        code, said, (line,) = verb(node, *arguments, "--timeout", limit_s)
        assert (code, said) == (1, [])
        assert f"within {limit_s} s" in line
        if "none in this ROS domain" not in line:
            return line
        limit_s *= 2


def values(peer: Peer, node: str, *names: str) -> list[object]:
    """Return a node's parameters of these names."""
    response = peer.call(GetParameters, f"/{node.lstrip('/')}/get_parameters", names=names)
    return [parameter_value_to_python(value) for value in response.values]
