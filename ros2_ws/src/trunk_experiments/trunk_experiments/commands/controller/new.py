"""``trunk controller new``: a package to start from."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from typing import Annotated

import click

from trunk_control.laws import REGISTERED

from ...console.document import json_option, write_json
from ...errors import PlanError
from ...plans.nodes import OTHERS
from ...results import Keyword, Result

_NAME = re.compile(r"[a-z][a-z0-9_]*[a-z0-9]")


@dataclass(frozen=True)
class NewResult(Result, document="new-1"):
    """The document of ``trunk controller new``."""

    folder: Path
    files: Annotated[list[Path], Keyword("minItems", 1)]
    law: Annotated[Path, "The file to change"]
    readme: Path


@click.command("new")
@click.argument("name")
@click.option(
    "--path",
    type=click.Path(path_type=Path),
    default=Path(),
    help="The folder to make it in.  [default: the current one]",
)
@json_option(NewResult)
def command(name: str, path: Path, as_json: bool) -> None:
    """Make the package NAME: a sliding-mode controller to change into your own."""
    from ...templates import controller_package

    if not _NAME.fullmatch(name) or "__" in name:
        raise PlanError(
            f"{name!r} is not a valid name for a package and a node: use two or more lower-case letters, "
            "digits and single underscores, starting with a letter"
        )
    spec = find_spec(name)
    if iskeyword(name) or (spec is not None and spec.origin is not None):
        raise PlanError(
            f"{name!r} belongs to Python or to an installed package: choose another name"
        )
    if name in (*REGISTERED, *OTHERS):
        raise PlanError(f"{name!r} is taken by another node: choose another name")
    folder = path / name
    if folder.exists():
        raise PlanError(f"{folder} exists, and nothing was written: choose another name or --path")
    if not path.is_dir():
        raise PlanError(f"{path}: there is no such folder: make it, or give another --path")
    files, law, readme = [], folder / name / "law.py", folder / "README.md"
    for file in controller_package(name, folder):
        files.append(file)
        if not as_json:
            click.echo(file)
    if as_json:
        write_json(NewResult(folder, files, law, readme))
    else:
        click.echo(f"next: see {readme}; the law is in {law}")
