"""Parameter values as callers give them: of Python's or NumPy's types, by ``NODE.PARAM``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trunk_msgs_util.parameters.files import Layer, Section

from ..errors import PlanError, did_you_mean
from ..plans.nodes import CONTROLLERS, NODES
from ._paths import AnyPath, path_of


def plain(value: Any) -> Any:
    """Return a NumPy value as one of Python's own types; a sequence becomes a list."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [plain(item) for item in value]
    return value


def layers_of(overrides: Mapping[str, object], acting: Sequence[str]) -> list[Layer]:
    """Return a layer for each override; ``acting``: the controllers of the run.

    Raises PlanError for a name that is not ``NODE.PARAM``, and for a node that is not in the run.
    """
    layers = []
    nodes = [name for name in NODES if name not in CONTROLLERS or name in acting]
    for target, value in mapping_of(overrides, "overrides", "{'NODE.PARAM': value}").items():
        node, dot, name = str(target).partition(".")
        if not dot or not name or node not in NODES:
            raise PlanError(
                f"overrides: {target!r}: NODE.PARAM is needed, NODE one of {', '.join(nodes)}"
                f"{did_you_mean(node, nodes) if dot else ''}"
            )
        if node not in nodes:
            raise PlanError(
                f"overrides: {target!r}: {node} is not in this run: give one of {', '.join(nodes)}"
            )
        layers.append(Layer(f"overrides: {target}", (Section(node, {name: plain(value)}),)))
    return layers


def mapping_of(value: Any, subject: str, such_as: str) -> Mapping[str, Any]:
    """Return a mapping. Raises PlanError, naming what it is for, if the value is not one."""
    if not isinstance(value, Mapping):
        raise PlanError(f"{subject} {value!r}: a mapping is needed, such as {such_as}")
    return value


def names_of(value: AnyPath | Sequence[AnyPath], subject: str) -> list[str]:
    """Return one or more names or paths as a list of strings. Raises PlanError for anything else."""
    values: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
    return [str(path_of(item, subject)) for item in values]


def number_of(value: Any, subject: str) -> Any:
    """Return a number as Python's own, None and strings as they are. Raises PlanError for anything else."""
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int | float | str | None):
        raise PlanError(f"{subject} {value!r}: a number is needed")
    return value
