"""Packages to begin with: text files with ``$name`` (string.Template) for what varies."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from string import Template


def controller_package(name: str, folder: Path) -> Iterator[Path]:
    """Write a controller's package into a new folder; yield each file. Raises OSError."""
    source = Path(str(files(__package__))) / "controller"
    values = {"name": name, "package": name, "label": name.replace("_", " ").capitalize()}
    for template in sorted(source.rglob("*.in")):
        place = template.relative_to(source).with_suffix("")
        parts = [name if part == "package" else part for part in place.parts]
        target = folder.joinpath(*parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(Template(template.read_text("utf-8")).substitute(values), "utf-8")
        yield target
