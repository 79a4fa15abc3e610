"""A package to begin with, of a controller or a plant: what the verbs that write one share.

Its files are made from those in ``templates``: text with ``$name`` (string.Template) for what varies.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator, Mapping
from importlib.resources import files
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from string import Template

import click

from trunk_core.errors import PlanError

_NAME = re.compile(r"[a-z][a-z0-9_]*[a-z0-9]")

path_option = click.option(
    "--path",
    type=click.Path(path_type=Path),
    default=Path(),
    help="The folder to make it in.  [default: the current one]",
)


def checked_name(name: str, noun: str, taken: Container[str]) -> str:
    """Return a new package's name, which a ``noun`` has too. Raises PlanError for one that it cannot have."""
    if not _NAME.fullmatch(name) or "__" in name:
        raise PlanError(
            f"{name!r} is not a valid name for a package and a {noun}: use two or more lower-case letters, "
            "digits and single underscores, starting with a letter"
        )
    spec = find_spec(name)
    if iskeyword(name) or (spec is not None and spec.origin is not None):
        raise PlanError(
            f"{name!r} belongs to Python or to an installed package: choose another name"
        )
    if name in taken:
        raise PlanError(f"{name!r} is taken by another {noun}: choose another name")
    return name


def written(
    write: Callable[[str, Path], Iterator[Path]], name: str, path: Path, quiet: bool
) -> tuple[Path, list[Path]]:
    """Write a package below a path, each file told unless ``quiet``; return its folder and the files.

    Raises PlanError, before anything is written, where the folder exists or the path does not.
    """
    folder, made = path / name, []
    if folder.exists():
        raise PlanError(f"{folder} exists, and nothing was written: choose another name or --path")
    if not path.is_dir():
        raise PlanError(f"{path}: there is no such folder: make it, or give another --path")
    for file in write(name, folder):
        made.append(file)
        if not quiet:
            click.echo(file)
    return folder, made


def controller_package(name: str, folder: Path) -> Iterator[Path]:
    """Write a controller's package into a new folder; yield each file. Raises OSError."""
    script = f'"console_scripts": ["{name} = {name}.executables:main"],'
    entries = f'{script}\n        "trunk.controllers": ["{name} = {name}.law:LAW"],'
    values = {"kind": "controller", "kit": "law", "needs": "trunk_control", "entries": entries}
    yield from _package("controller", name, folder, values)


def plant_package(name: str, folder: Path) -> Iterator[Path]:
    """Write a plant's package, the cart-pole's equations in it; yield each file. Raises OSError."""
    from trunk_sim.plants import cart_pole

    entries = f'"trunk.plants": ["{name} = {name}.plant:PLANT"],'
    values = {"kind": "plant", "kit": "plant", "needs": "trunk_sim", "entries": entries}
    yield from _package("plant", name, folder, values)
    source = Path(cart_pole.__file__).read_text("utf-8")
    for old, new in (
        ("CartPoleConfig", "Config"),
        ("CartPole", "Constants"),
        ('"cart_pole"', f'"{name}"'),
        ('"Cart-pole"', f'"{_label(name)}"'),
    ):
        source = source.replace(old, new)
    module = folder / name / "plant.py"
    module.write_text(source, "utf-8")
    yield module


def _label(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _package(kind: str, name: str, folder: Path, values: Mapping[str, str]) -> Iterator[Path]:
    """Write what all packages have, and what those of a kind have."""
    values = {**values, "name": name, "package": name, "label": _label(name)}
    templates = Path(str(files("trunk_experiments"))) / "templates"
    for source in (templates / part for part in ("common", kind)):
        for template in sorted(source.rglob("*.in")):
            place = template.relative_to(source).with_suffix("")
            parts = [name if part == "package" else part for part in place.parts]
            target = folder.joinpath(*parts)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(Template(template.read_text("utf-8")).substitute(values), "utf-8")
            yield target
