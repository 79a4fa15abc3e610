"""`Plan`: everything that decides a run, from names and overrides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from types import MappingProxyType
from typing import Any

from trunk_msgs_util.parameters.declarations import Value, values_of
from trunk_msgs_util.text import printable

from ..errors import PlanError, did_you_mean
from ..plans.nodes import CONTROLLERS
from ..plans.plan import RunPlan, Swap, make_plan
from ..results import html_table
from ._values import (
    AnyPath,
    keyed,
    layers_of,
    names_of,
    number_of,
    output_path,
    path_of,
    writing,
)


@dataclass(frozen=True, repr=False)
class Plan:
    """Everything that decides a run: all parameters of all nodes, and whose turn it is when.

    Made by `plan` and `Run.plan`.
    """

    _plan: RunPlan

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return self._plan.scenario

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controllers, in the order of their first turns."""
        return tuple(self._plan.controllers)

    @property
    def duration(self) -> float:
        """Simulated time in s; 0: no end, which `simulate` refuses."""
        return self._plan.simulator.duration

    @property
    def rate(self) -> float:
        """Rate of the plant's steps in Hz: a run has ``duration * rate + 1`` states."""
        return self._plan.simulator.update_rate

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Value]]:
        """Every node's parameters by name, in SI units and radians; for the units: `parameters`."""
        nodes = {name: values_of(config) for name, config in self._plan.configs.items()}
        return keyed(nodes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was most likely not intended, one line each."""
        return self._plan.warnings

    def save(self, path: AnyPath, *, overwrite: bool = False) -> None:
        """Write all parameters as one ROS 2 parameter file, for nodes that are started elsewhere.

        Raises PlanError for a file that exists, unless ``overwrite``, or a name not ending in
        ``.yaml`` or ``.yml``.
        """
        target = output_path(path, (".yaml", ".yml"), overwrite)
        with writing(target):
            self._plan.write_parameters(target)

    def _facts(self) -> dict[str, str]:
        facts = {
            "scenario": self.scenario,
            "controllers": ", ".join(self.controllers),
            "duration": f"{self.duration:g} s",
            "rate": f"{self.rate:g} Hz",
        }
        return facts | {f"warning {i}": text for i, text in enumerate(self.warnings, 1)}

    def __repr__(self) -> str:
        summary = f"{self.scenario}, {', '.join(self.controllers)}, {self.duration:g} s at {self.rate:g} Hz"
        return printable(f"Plan({'; '.join((summary, *self.warnings))})")

    def _repr_html_(self) -> str:
        return html_table("Plan", ("", ""), self._facts().items())


def plan(
    scenario: AnyPath,
    controller: str = "fuzzy_pid",
    *,
    params: AnyPath | Sequence[AnyPath] = (),
    overrides: Mapping[str, Any] = MappingProxyType({}),
    duration: float | None = None,
    rate: float | None = None,
    swaps: Sequence[tuple[float, str]] = (),
    pushes: Sequence[str] = (),
) -> Plan:
    """Return the plan of a run; all files are read and all values checked.

    ``scenario``: one of `scenarios`, or a parameter file's path.
    ``controller``: one of `controllers`.
    ``params``: parameter files on top, by path or one of `parameter_files`; later ones win.
    ``overrides``: single values by ``"NODE.PARAM"``, in SI units and radians; they win over all files.
    For an array, give a sequence or a NumPy array.
    ``duration``: simulated time in s. ``rate``: of simulator and controllers in Hz.
    ``swaps``: pairs of a time in s and the controller that takes over then, in ascending order.
    ``pushes``: pulses besides the scenario's, as `trunk simulate --push` takes them: ``"60Nm:0.1s@3"``.

    Raises PlanError, ParameterError or another `TrunkError`: one line with the name, its value, and what is
    allowed.
    """
    turns = _swaps(swaps)
    acting = [str(controller), *(turn.controller for turn in turns)]
    everywhere = {
        name: value
        for name, value in (
            ("duration", number_of(duration, "duration")),
            ("update_rate", number_of(rate, "rate")),
        )
        if value is not None
    }
    made = make_plan(
        str(path_of(scenario, "scenario")),
        str(controller),
        names_of(params, "params"),
        layers_of(overrides, acting),
        everywhere,
        swaps=turns,
        pushes=list(names_of(pushes, "pushes")),
    )
    return Plan(made)


def _swaps(swaps: Any) -> list[Swap]:
    """Return the swaps. Raises PlanError unless they are a list or tuple of swaps."""
    if not isinstance(swaps, list | tuple):
        raise PlanError(f"swaps {swaps!r}: a list is needed, such as [(4.0, 'pid')]")
    return [_swap(swap) for swap in swaps]


def _swap(pair: Any) -> Swap:
    """Return a swap. Raises PlanError unless it is a time and a controller's name."""
    time, name = pair if isinstance(pair, tuple | list) and len(pair) == 2 else (None, None)
    time = number_of(time, "swaps: time")
    if not isinstance(time, int | float) or not isfinite(time) or name not in CONTROLLERS:
        raise PlanError(
            f"swaps: {pair!r}: a time in s and a controller are needed, such as (4.0, 'pid'); controllers: "
            f"{', '.join(CONTROLLERS)}{did_you_mean(str(name), CONTROLLERS)}"
        )
    return Swap(float(time), name)
