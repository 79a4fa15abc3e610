"""The picture of the layers in docs/design.md is what `lint-imports` checks."""

from __future__ import annotations

import re
from pathlib import Path

from importlinter import api

ROOT = Path(__file__).parents[1]


def as_drawn(layers: list[str]) -> list[str]:
    """Return the layers of a contract as the page writes them: a colon is a comma there."""
    return [layer.replace(" : ", ", ") for layer in layers]


def drawn() -> dict[str, list[str]]:
    """Return the layers of each package, top down, from the indented block below the sentence on imports."""
    page = (ROOT / "docs" / "design.md").read_text()
    block = page.split("do not import one another:\n", 1)[1].split("\n`lint-imports`", 1)[0]
    found: dict[str, list[str]] = {}
    for line in block.splitlines():
        if row := re.fullmatch(r" {4}(\S.*?) {2,}(\S.*)", line):
            package, layer = row.groups()
            found[package] = [layer]
        elif re.match(r" {4}\S", line):
            found[line.strip()] = []
        elif line.strip():  # a line that ends in a comma goes on in the next
            layers = found[package]
            if layers[-1].endswith(","):
                layers[-1] += " " + line.strip()
            else:
                layers.append(line.strip())
    return found


def test_the_picture_shows_the_contracts():
    contracts = api.read_configuration(str(ROOT / "pyproject.toml"))["contracts_options"]
    layers = {contract["name"]: as_drawn(contract["layers"]) for contract in contracts}
    picture = drawn()
    assert list(picture) == layers.pop("The four packages")
    assert {package: found for package, found in picture.items() if found} == layers


def test_what_the_page_points_to_is_there():
    page = (ROOT / "docs" / "design.md").read_text()
    table = page.split("## Where is …?\n", 1)[1].split("\n\n`trunk verify` runs", 1)[0]
    rows = [line.split("|")[2:4] for line in table.splitlines()[3:]]
    assert len(rows) >= 15
    for file, functions in rows:
        path = file.strip(" `")
        package = path.split("/")[0]
        text = (ROOT / "ros2_ws" / "src" / package / path).read_text()
        name = re.search(r"`(\w+)(?:\.(\w+))?`", functions)
        for part in filter(None, name.groups()):
            assert re.search(rf"(def|class) {part}\b", text), (path, part)
