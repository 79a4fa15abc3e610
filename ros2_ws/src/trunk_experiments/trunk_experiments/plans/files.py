"""How a user specifies a run: scenarios, parameter files, single values."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from trunk_msgs_util.parameters.files import Layer, Section, read

from ..errors import PlanError, did_you_mean
from .given import quoted, value_of
from .nodes import NODES

# The profile that a shipped scenario builds on.
SCENARIOS: dict[str, str] = {
    "fig6": "profile_paper",
    "fig7": "profile_paper",
    "fig8": "profile_paper",
    "fig9": "profile_paper",
    "demo": "profile_practical",
}


def shipped_files() -> dict[str, Path]:
    """Return the shipped parameter files by bare name."""
    folder = Path(str(files("trunk_experiments"))) / "config"
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


def scenario_layers(scenario: str) -> list[Layer]:
    """Return a scenario's layers: the profile it builds on, then its own file."""
    if scenario in SCENARIOS:
        return [read(find_file(SCENARIOS[scenario])), read(find_file(scenario))]
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
