"""``trunk controller``: a controller of your own: a package to start from, and whether it is sound."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_control.laws import REGISTERED, law_named, package_of
from trunk_core.plugins import PluginError
from trunk_core.results import Keyword, Result
from trunk_runs.nodes import CONTROLLERS, OTHERS, UNUSABLE

from ..console.document import json_option, write_json
from ..console.options import Name
from ..console.own_packages import checked_name, controller_package, path_option, written
from ..console.verbs import OrderedVerbs


@click.group("controller", cls=OrderedVerbs)
def command() -> None:
    """Make a controller of your own, a law in Python, and check it."""


@dataclass(frozen=True)
class NewResult(Result, document="new-1"):
    """The document of ``trunk controller new``."""

    folder: Path
    files: Annotated[list[Path], Keyword("minItems", 1)]
    law: Annotated[Path, "The file to change"]
    readme: Path


@command.command(
    "new", short_help="Make a package: a sliding-mode controller to change into your own."
)
@click.argument("name")
@path_option
@json_option(NewResult)
def new_command(name: str, path: Path, as_json: bool) -> None:
    """Make the package NAME: a sliding-mode controller to change into your own."""
    checked_name(name, "node", (*REGISTERED, *OTHERS))
    folder, files = written(controller_package, name, path, as_json)
    law, readme = folder / name / "law.py", folder / "README.md"
    if as_json:
        write_json(NewResult(folder, files, law, readme))
    else:
        click.echo(f"next: see {readme}; the law is in {law}")


@command.command("check", short_help="Apply the conformance kit to a registered controller.")
@click.argument("name", type=Name((*CONTROLLERS, *UNUSABLE)))
@json_option("trunk_experiments.console.kit_checks:CheckResult")
def check_command(name: str, as_json: bool) -> None:
    """Apply the conformance kit to a registered controller; exit code 1 if anything is found."""
    from ..conformance.law import KIT
    from ..console.kit_checks import CheckResult, run_kit

    if name in UNUSABLE:
        raise PluginError(UNUSABLE[name])
    run_kit(KIT, CheckResult, name, law_named(name).label, package_of(name), as_json)
