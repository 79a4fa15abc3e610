"""``trunk plant``: a plant of your own: a package to start from, and whether it is sound."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_core.results import Keyword, Result
from trunk_sim.plant import PLANTS

from ..console.document import json_option, write_json
from ..console.options import Name
from ..console.own_packages import checked_name, path_option, plant_package, written
from ..console.verbs import OrderedVerbs


@click.group("plant", cls=OrderedVerbs)
def command() -> None:
    """Make a plant of your own, equations of motion in Python, and check it."""


@dataclass(frozen=True)
class NewPlantResult(Result, document="new-plant-1"):
    """The document of ``trunk plant new``."""

    folder: Path
    files: Annotated[list[Path], Keyword("minItems", 1)]
    plant: Annotated[Path, "The file to change"]
    scenario: Annotated[Path, "A scenario with it"]
    readme: Path


@command.command("new", short_help="Make a package: a cart-pole to change into your own plant.")
@click.argument("name")
@path_option
@json_option(NewPlantResult)
def new_command(name: str, path: Path, as_json: bool) -> None:
    """Make the package NAME: a cart-pole to change into your own plant."""
    checked_name(name, "plant", PLANTS.names)
    folder, files = written(plant_package, name, path, as_json)
    plant, readme = folder / name / "plant.py", folder / "README.md"
    if as_json:
        scenario = folder / name / "config" / "upright.yaml"
        write_json(NewPlantResult(folder, files, plant, scenario, readme))
    else:
        click.echo(f"next: see {readme}; the plant is in {plant}")


class _Plant(Name):
    """The name of an installed plant."""

    hint = "; build and source your own package first, with its entry point of trunk.plants"


@command.command("check", short_help="Apply the conformance kit to an installed plant.")
@click.argument("name", type=_Plant(PLANTS.names))
@json_option("trunk_experiments.console.kit_checks:PlantCheckResult")
def check_command(name: str, as_json: bool) -> None:
    """Apply the conformance kit to an installed plant; exit code 1 if anything is found."""
    from ..conformance.plant import KIT
    from ..console.kit_checks import PlantCheckResult, run_kit

    label, package = PLANTS.named(name).label, PLANTS.package_of(name)
    run_kit(KIT, PlantCheckResult, name, label, package, as_json)
