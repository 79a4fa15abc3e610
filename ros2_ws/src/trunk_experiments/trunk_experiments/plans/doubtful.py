"""What a user most likely did not mean: values for nodes that do not run, degrees, centimetres."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from math import degrees, isfinite, pi
from typing import Any

from trunk_msgs_util.parameters.declarations import declarations, values_of
from trunk_msgs_util.parameters.files import Layer

from ..errors import PlanError, closest
from .nodes import CONTROLLERS, NODES


def check_targets(settings: Iterable[Layer], taking: Sequence[str]) -> None:
    """Raise PlanError for a single value that no node of the run takes."""
    for layer in settings:
        node = layer.sections[0].pattern
        if node not in taking:
            acting = ", ".join(name for name in taking if name in CONTROLLERS)
            raise PlanError(
                f"{layer.source}: no node of this run takes it: {acting} acts; "
                f"give --controller {node}, or name another node: {', '.join(taking)}"
            )


def not_taken(files: Iterable[Layer], taking: Sequence[str], namespace: str = "") -> Iterator[str]:
    """Yield a warning for each file that changes nothing, and each misspelt node.

    ``files``: their relative node names are in the ``namespace`` already.
    """
    for layer in files:
        used = [
            s for s in layer.sections if any(s.matches(f"{namespace}/{node}") for node in taking)
        ]
        names = list(dict.fromkeys(s.last_token for s in layer.sections))
        for name in names:
            meant = closest(name, NODES)
            if name not in NODES and "*" not in name and meant:
                yield f"{layer.source}: no node is called {name!r}; did you mean {meant!r}?"
        if not used:
            patterns = dict.fromkeys(s.pattern for s in layer.sections)
            full = namespace or any("/" in pattern for pattern in patterns)
            nodes = [f"{namespace}/{node}" if full else node for node in taking]
            line = (
                f"{layer.source}: no node of this run uses anything in it: it is for "
                f"{', '.join(patterns)}; the run has {', '.join(nodes)}"
            )
            elsewhere = [s for s in layer.sections if s.last_token in taking]
            if elsewhere:
                name = elsewhere[0].last_token
                above = "/" + elsewhere[0].pattern.strip("/").rpartition("/")[0]
                line += f": call the section {name}, or run in the namespace {above}"
            yield line


def suspicious_units(
    configs: Mapping[str, Any], with_units: Mapping[str, Collection[str]]
) -> Iterator[str]:
    """Yield a warning for each angle of more than a turn, and each length beyond a limb's.

    They were most likely meant in degrees, and in centimetres. ``with_units``: by node, the parameters in
    whose values a unit is written: those are meant.
    """
    for node, config in configs.items():
        values = values_of(config)
        for name, declared in declarations(type(config)).items():
            if name in with_units.get(node, ()) or values[name] == declared.default:
                continue
            for value in _angles(name, declared.unit, values[name]):
                if 2.0 * pi < abs(value) < 1e300:
                    yield (
                        f"{node}: {name} is {value:g} rad, which is {degrees(value):.0f} degrees: "
                        "angles are in radians, unless given with a unit, such as 30 deg"
                    )
            if name in _LENGTHS and values[name] > LONGEST:  # type: ignore[operator]
                yield (
                    f"{node}: {name} is {values[name]:g} m: lengths are in metres, unless given with a unit, "
                    "such as 60 cm"
                )


LONGEST = 10.0  # m
_LENGTHS = ("plant.length", "model.length")


def _angles(name: str, unit: str | None, value: Any) -> list[float]:
    if name == "initial.position":
        return [value[1]]
    if unit != "rad":
        return []
    return [angle for angle in (value if isinstance(value, tuple) else (value,)) if isfinite(angle)]
