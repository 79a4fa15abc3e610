"""`Study`: which runs a sweep makes, from names, overrides and what varies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import yaml

from trunk_msgs_util.yaml_text import dump

from ..errors import StudyError
from ._values import AnyPath, mapping_of, names_of, number_of, path_of, plain

if TYPE_CHECKING:
    from ..study.study import StudySpec

How = Literal["value", "factor", "offset"]
Distribution = Literal["uniform", "loguniform", "normal", "integers", "choice"]


@dataclass(frozen=True)
class Contender:
    """One controller of a study: its node, and its own parameter files and overrides."""

    node: str
    params: AnyPath | Sequence[AnyPath] = ()
    overrides: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Variation:
    """What varies in a study, as written in its file. Made by `grid` and `draw`."""

    entry: Mapping[str, Any]


@dataclass(frozen=True, repr=False)
class Study:
    """The runs that a sweep makes. Made by `study` and `read_study`."""

    _study: StudySpec

    @property
    def text(self) -> str:
        """The study as the YAML file that `trunk sweep` takes."""
        return self._study.text

    @property
    def runs(self) -> int:
        """How many runs there are in all: grid points times draws times controllers."""
        return self._study.total

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controllers' labels."""
        return tuple(contender.label for contender in self._study.contenders)

    @property
    def variables(self) -> tuple[str, ...]:
        """The names of what varies; each is a column of the results."""
        return tuple(variable.name for variable in self._study.variables)

    def __repr__(self) -> str:
        return (
            f"Study({self._study.scenario}: {self.runs} runs of {', '.join(self.controllers)} "
            f"over {', '.join(self.variables)})"
        )


def grid(parameter: str | Sequence[str], values: Sequence[Any], *, how: How = "value") -> Variation:
    """Return a variation over given values; all grids of a study are combined.

    ``parameter``: ``"NODE.PARAM"`` or ``"NODE.PARAM[INDEX]"``, or several that vary together; the node
    ``controller`` is whichever controller runs. ``values``: numbers (a NumPy array too), strings or bools.
    ``how``: a value replaces the parameter, multiplies it as a factor, or is added to it as an offset.
    """
    return _variation(parameter, how, {"values": plain(values)})


def draw(
    parameter: str | Sequence[str],
    distribution: Distribution,
    *,
    low: float | None = None,
    high: float | None = None,
    mean: float | None = None,
    std: float | None = None,
    values: Sequence[Any] | None = None,
    how: How = "value",
) -> Variation:
    """Return a variation that is drawn for each run, from its own random stream.

    ``distribution``: ``uniform``, ``loguniform`` or ``integers`` need ``low`` and ``high``, ``normal`` needs
    ``mean`` and ``std`` (``low`` and ``high`` truncate it), ``choice`` needs ``values``. All are in
    the parameter's unit, unless ``how`` is ``factor``. The rest is as for `grid`.
    """
    given = {"low": low, "high": high, "mean": mean, "std": std, "values": values}
    options = {name: plain(value) for name, value in given.items() if value is not None}
    return _variation(parameter, how, {"distribution": distribution, **options})


def _variation(parameter: str | Sequence[str], how: How, rest: Mapping[str, Any]) -> Variation:
    entry = {"parameter": plain(parameter), "as": how, **rest}
    return Variation(MappingProxyType(entry))


def study(
    scenario: AnyPath,
    controllers: Sequence[str] | Mapping[str, Contender],
    vary: Mapping[str, Variation],
    *,
    params: AnyPath | Sequence[AnyPath] = (),
    overrides: Mapping[str, Any] = MappingProxyType({}),
    duration: float | None = None,
    rate: float | None = None,
    runs: int = 1,
    seed: int = 1,
) -> Study:
    """Return a study. The draws are the same for all controllers and at all points of the grid.

    ``scenario``, ``params``, ``overrides``, ``duration`` in s, ``rate`` in Hz: as for `plan`, for all runs.
    ``controllers``: some of `controllers`, or your own labels, each with a `Contender`.
    ``vary``: what varies, made by `grid` and `draw`, by the name of its column in the results.
    ``runs``: draws at each point of the grid. ``seed``: of the draws.

    Raises StudyError: one line with the place, the value, and what is allowed. `sweep` checks the
    parameters' names and bounds, before its first run.
    """
    contenders: Any = plain(controllers)
    if isinstance(controllers, Mapping):
        contenders = {str(label): _contender(contender) for label, contender in controllers.items()}
    tree = {
        "scenario": str(path_of(scenario, "scenario")),
        "controllers": contenders,
        "params": names_of(params, "params"),
        "set": _overrides(overrides),
        "rate": number_of(rate, "rate"),
        "duration": number_of(duration, "duration"),
        "runs": plain(runs),
        "seed": plain(seed),
        "vary": {str(name): _entry(name, variation) for name, variation in _varied(vary).items()},
    }
    return Study(_parsed({name: value for name, value in tree.items() if value is not None}))


def read_study(name: AnyPath) -> Study:
    """Return the study in a YAML file, given by its path or as one of `studies`. Raises StudyError."""
    from ..study.study import read_study as read

    return Study(read(str(path_of(name, "study"))))


def _parsed(tree: Mapping[str, Any]) -> StudySpec:
    """Return the study that a file's content describes, checked as every study is."""
    from ..study.study import parse_study

    try:
        text = dump(dict(tree), allow_unicode=True)
    except yaml.YAMLError as error:
        raise StudyError(f"study: {' '.join(str(error).split())}") from None
    return parse_study(text, "study")


def _overrides(value: Mapping[str, Any]) -> dict[str, Any]:
    overrides = mapping_of(value, "overrides", "{'NODE.PARAM': value}")
    return {str(name): plain(override) for name, override in overrides.items()}


def _varied(value: Mapping[str, Variation]) -> Mapping[str, Variation]:
    return mapping_of(
        value, "vary", "{'mass': trunk.grid('simulator.plant.trunk_mass', [0.4, 0.6])}"
    )


def _contender(contender: Contender) -> dict[str, Any]:
    if not isinstance(contender, Contender):
        raise StudyError(
            f"controllers: {contender!r} is not a contender: give trunk.Contender('pid', ...)"
        )
    return {
        "node": contender.node,
        "params": names_of(contender.params, "params"),
        "set": _overrides(contender.overrides),
    }


def _entry(name: str, variation: Variation) -> dict[str, Any]:
    if not isinstance(variation, Variation):
        raise StudyError(f"vary: {name}: {variation!r}: give trunk.grid(...) or trunk.draw(...)")
    return dict(variation.entry)
