"""No two classes of the packages have one name, so that a name in an error or a search means one thing."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

SOURCES = Path(__file__).parents[1] / "ros2_ws" / "src"


def classes(path: Path) -> list[str]:
    return [
        node.name
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    ]


def test_no_class_name_stands_twice():
    places = defaultdict(list)
    for package in (path.parent for path in SOURCES.glob("*/package.xml")):
        for path in sorted((package / package.name).rglob("*.py")):
            for name in classes(path):
                places[name].append(str(path.relative_to(SOURCES)))
    assert len(places) > 300
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}
