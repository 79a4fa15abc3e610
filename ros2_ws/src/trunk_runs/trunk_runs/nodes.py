"""The project's nodes: where each one's executable is, and what it declares."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from traceback import extract_tb
from typing import Annotated, Any, NamedTuple

from trunk_control.laws import REGISTERED, law_named, package_of
from trunk_control.reference import ReferenceConfig
from trunk_core import PACKAGES
from trunk_core.parameters.declarations import Value, listed
from trunk_core.parameters.shared import PLANT_NAME, RecorderConfig
from trunk_core.plugins import PluginError
from trunk_sim.config import TrunkSimulator, simulator_class
from trunk_sim.disturbance_config import DisturbanceConfig, disturbance_class
from trunk_sim.plant import PLANTS, TRUNK, config_for

# What is not a controller's name.
OTHERS = ("simulator", "disturbance", "reference", "recorder", "markers")


@dataclass(frozen=True)
class NodeKind:
    """Where a node's executable is, what it declares, its class. Node and executable share their name.

    ``chosen``: returns what it declares with the plant that ``plant.name`` among values names.
    """

    package: str
    config: type[Any]
    node: str = "trunk_control.controller_node:ControllerNode"
    chosen: Callable[[Mapping[str, object]], type[Any]] | None = None


def _usable() -> tuple[dict[str, NodeKind], dict[str, str]]:
    """Return the controllers that can be used, and why others cannot."""
    kinds, unusable = {}, {}
    for name in REGISTERED:
        try:
            if name in OTHERS:
                raise PluginError(
                    f"controller {name!r} of package {package_of(name)}: another node has the name: rename it"
                )
            config = law_named(name).config
            chosen = partial(config_for, config, config)
            kinds[name] = NodeKind(package_of(name), config, chosen=chosen)
        except PluginError as error:
            unusable[name] = str(error)
    return kinds, unusable


_CONTROLLERS, UNUSABLE = _usable()
CONTROLLERS = tuple(_CONTROLLERS)
NODES: dict[str, NodeKind] = {
    "simulator": NodeKind(
        "trunk_sim", TrunkSimulator, "trunk_sim.simulator_node:SimulatorNode", simulator_class
    ),
    "disturbance": NodeKind(
        "trunk_sim",
        DisturbanceConfig,
        "trunk_sim.disturbance_node:DisturbanceNode",
        disturbance_class,
    ),
    "reference": NodeKind(
        "trunk_control",
        ReferenceConfig,
        "trunk_control.reference_node:ReferenceNode",
        partial(config_for, ReferenceConfig, ReferenceConfig),
    ),
    **_CONTROLLERS,
    "recorder": NodeKind(
        "trunk_msgs_util", RecorderConfig, "trunk_msgs_util.node.recorder_node:RecorderNode"
    ),
}


def why_not_with(plant: str, node: str) -> str:
    """Return why a node cannot be used with a plant; empty if it can."""
    model = law_named(node).plant if node in CONTROLLERS else ""
    if model in ("", plant):
        return ""
    return (
        f"{node}: it contains a model of the plant {model}, and this one is {plant}: "
        "give another controller"
    )


def config_class(node: str, values: Mapping[str, object] | None = None) -> type[Any]:
    """Return the class of a node's parameters, with the plant that ``plant.name`` among values names.

    Raises KeyError for a node that is not ours, ParameterError for a plant that is not installed, or
    cannot be used.
    """
    kind = NODES[node]
    return kind.config if kind.chosen is None else kind.chosen(values or {})


def unknown_controllers(names: Iterable[str]) -> str:
    """Return which of these controllers are not usable here, and what to do; empty if all are."""
    unknown = [name for name in names if name not in CONTROLLERS]
    if not unknown:
        return ""
    reasons = [UNUSABLE[name] for name in unknown if name in UNUSABLE]
    are = "is" if len(unknown) == 1 else "are"
    return "; ".join(
        [f"{', '.join(unknown)} {are} not known here: install the package that has it", *reasons]
    )


class Parameter(NamedTuple):
    """What a node declares about one parameter; numbers are in ``unit``, SI."""

    type: str
    default: Value
    unit: str
    allowed: str
    description: str
    fixed: Annotated[bool, "Only at start"]


def parameters_of(node: str, plant: str = TRUNK) -> dict[str, Parameter]:
    """Return the declared parameters of a node, by name. Raises as `config_class` does."""
    return {
        d.name: Parameter(d.kind, d.default, d.unit, d.allowed(), d.description, d.fixed)
        for d in listed(config_class(node, {PLANT_NAME: plant})).values()
    }


def declared_names(plant: str = TRUNK) -> dict[str, tuple[str, ...]]:
    """Return, for each node, the names that a parameter file may set in a run with a plant.

    Raises as `config_class` does.
    """
    chosen = {PLANT_NAME: plant}
    names = {name: tuple(listed(config_class(name, chosen))) for name in NODES}
    return {**names, "simulator": tuple(dict.fromkeys((*names["simulator"], PLANT_NAME)))}


def fault_of_a_law(error: BaseException) -> str:
    """Return which law or plant failed, how and where, if one of another package raised it; else empty."""
    for frame in reversed(extract_tb(error.__traceback__)):
        file = Path(frame.filename).resolve()
        for noun, name, place in _places():
            if place == file or place in file.parents:
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                return (
                    f"{noun} {name!r}: {file}, line {frame.lineno}, in {frame.name}: {reason}; "
                    f"trunk {noun} check {name} tests it alone"
                )
    return ""


def _places() -> Iterator[tuple[str, str, Path]]:
    """Yield laws and plants of other packages, each with its package's folder, or the file of its module."""
    functions: list[tuple[str, str, object]] = [
        ("controller", name, law_named(name).update) for name in CONTROLLERS
    ]
    for name in PLANTS.names:
        with suppress(PluginError):
            functions.append(("plant", name, PLANTS.named(name).accelerations))
    for noun, name, function in functions:
        top = str(getattr(function, "__module__", "")).partition(".")[0]
        file = getattr(sys.modules.get(top), "__file__", None)
        if top not in PACKAGES and file is not None:
            path = Path(file).resolve()
            yield noun, name, path.parent if path.name == "__init__.py" else path
