"""How a user specifies a run: scenarios, parameter files, single values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from trunk_core.errors import PlanError, did_you_mean
from trunk_core.parameters.csv_files import numbers_for
from trunk_core.parameters.declarations import ParameterError, build, declarations, table_of
from trunk_core.parameters.parameter_files import Layer, ParameterFileError, Section, read, resolve
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.parameters.to_si import to_si, written_with_units
from trunk_core.text import shortened
from trunk_core.yaml_text import YamlTextError, load
from trunk_sim.plant import Plant

from .nodes import NODES, config_class


def quoted(text: str) -> str:
    """Return a text as an error quotes it."""
    return repr(shortened(text, 80))


def value_of(text: str, origin: str) -> object:
    """Return the value in a YAML text. Raises PlanError, which begins with ``origin``."""
    try:
        return load(text)
    except YamlTextError as error:
        raise PlanError(f"{origin}: the value cannot be read: {error}") from None


def settings_of(texts: Iterable[str]) -> Mapping[str, object]:
    """Return the values by name of ``NAME=VALUE`` texts; VALUE is YAML. Raises PlanError."""
    values: dict[str, object] = {}
    for text in texts:
        name, equals, value_text = text.partition("=")
        if not equals or not name:
            raise PlanError(f"{quoted(text)}: NAME=VALUE is needed, such as gains.p=70")
        if name in values:
            raise PlanError(f"{quoted(text)}: {name} is given twice: give one value")
        value = value_of(value_text, quoted(text))
        if value is None:
            raise PlanError(f"{quoted(text)}: no value: give one, an empty text as {name}='\"\"'")
        values[name] = value
    return values


def checked_external(name: str) -> str:
    """Return the name that a run with an external controller goes by. Raises PlanError."""
    if name and not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,99}", name):
        raise PlanError(
            f"--external {name!r} is not allowed: letters, digits and _, no digit first, such as my_pd"
        )
    if name in NODES:
        raise PlanError(
            f"--external {name}: that is a node of this project: give your node another name, "
            f"or run ours with --controller {name}"
        )
    return name


def checked_namespace(text: str) -> str:
    """Return a plan's namespace from a user's ``robot1`` or ``/robot1``; empty: none.

    Raises PlanError.
    """
    if text in ("", "/"):
        return ""
    namespace = "/" + text.strip("/")
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", namespace) or len(namespace) > 100:
        raise PlanError(
            f"namespace {text!r} is not allowed: at most 100 letters, digits and _, no digit first, "
            "such as robot1 or left/robot1"
        )
    return namespace


class Resolved(NamedTuple):
    """A node's configuration, and the parameters in whose values a unit is written."""

    config: Any
    with_units: set[str]


def config_from(node: str, layers: Sequence[Layer], namespace: str) -> Resolved:
    """Return a node's configuration, the CSV files that the layers name read.

    Raises ParameterFileError naming the layer of a wrong value.
    """
    full_name = f"{namespace}/{node}"
    config = config_class(node, resolve(full_name, layers, [PLANT_NAME]))
    declared = declarations(config)
    of_files = numbers_for(full_name, layers, config)
    values = resolve(full_name, layers, declared) | of_files.values
    try:
        return Resolved(
            build(config, to_si(declared, values)),
            written_with_units(declared, values) | of_files.with_units,
        )
    except ParameterError as error:
        source = _source(full_name, error.name, layers)
        note = ""
        if error.name in written_with_units(declared, values):
            note = _written(values[error.name], error)
        raise ParameterFileError(f"{source}: {node}: {error}{note}") from None


def plant_of(layers: Sequence[Layer], namespace: str) -> Plant:
    """Return the plant of a run. Raises ParameterFileError naming the layer of one that cannot be used."""
    simulator = f"{namespace}/simulator"
    try:
        config = config_class("simulator", resolve(simulator, layers, [PLANT_NAME]))
    except ParameterError as error:
        source = _source(simulator, PLANT_NAME, layers)
        raise ParameterFileError(f"{source}: simulator: {error}") from None
    plant: Plant = config.kind
    return plant


def plant_of_run(
    scenario: str | Layer, params: Sequence[str] = (), settings: Sequence[str] = ()
) -> Plant:
    """Return the plant of a run that is specified so. Raises PlanError and ParameterFileError."""
    files = [read(find_file(name)) for name in params]
    return plant_of([*scenario_layers(scenario), *files, *map(parse_setting, settings)], "")


def _source(node: str, name: str, layers: Sequence[Layer]) -> str:
    """Return the layer that gave a node its value of a parameter."""
    for layer in reversed(layers):
        if any(
            s.matches(node) and any(key == name or table_of(key, {name}) for key in s.values)
            for s in layer.sections
        ):
            return layer.source
    return "defaults"


def _written(value: object, error: ParameterError) -> str:
    """Return the value as the file has it, where the error shows it in SI units."""
    text = str(value)
    if isinstance(error.value, str) and error.value in text:
        return ""
    return f" (written {text if len(text) <= 60 else text[:57] + '...'})"


# The profile that a shipped scenario builds on, if any.
SCENARIOS: dict[str, str | None] = {
    "fig6": "profile_paper",
    "fig7": "profile_paper",
    "fig8": "profile_paper",
    "fig9": "profile_paper",
    "demo": "profile_practical",
    "cart_pole": None,
}


def shipped_files() -> dict[str, Path]:
    """Return the shipped parameter files by bare name."""
    folder = Path(str(files(__package__))) / "config"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find_file(name: str) -> Path:
    """Return a parameter file's path from a shipped bare name or a path.

    Raises PlanError listing the shipped names.
    """
    shipped = shipped_files()
    if name in shipped:
        return shipped[name]
    path = Path(name)
    if path.is_file():
        return path
    raise PlanError(
        f"no parameter file {name!r}: give a path, or one of {', '.join(sorted(shipped))}"
        f"{did_you_mean(name, shipped)}"
    )


def scenario_layers(scenario: str | Layer) -> list[Layer]:
    """Return a scenario's layers: the profile it builds on, if any, then its own file."""
    if isinstance(scenario, Layer):
        return [scenario]
    if scenario in SCENARIOS:
        names = filter(None, (SCENARIOS[scenario], scenario))
        return [read(find_file(name)) for name in names]
    if Path(scenario).is_file():
        return [read(Path(scenario))]
    raise PlanError(
        f"no scenario {scenario!r}: give one of {', '.join(SCENARIOS)}, or a parameter file's path"
        f"{did_you_mean(scenario, SCENARIOS)}"
    )


def parse_setting(text: str, origin: str = "--set") -> Layer:
    """Return the layer that ``NODE.PARAM=VALUE`` stands for; VALUE is YAML. Raises PlanError.

    ``origin``: where it came from, for messages.
    """
    target, equals, value_text = text.partition("=")
    source, origin = f"{origin} {text}", f"{origin} {quoted(text)}"
    node, dot, name = target.partition(".")
    if not equals or not dot or node not in NODES:
        raise PlanError(
            f"{origin}: NODE.PARAM=VALUE is needed, NODE one of {', '.join(NODES)}"
            f"{did_you_mean(node, NODES) if equals and dot else ''}"
        )
    return Layer(source, (Section(node, {name: value_of(value_text, origin)}),))
