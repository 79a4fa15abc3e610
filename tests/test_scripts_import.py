"""Everything that scripts and the checks among the tests import exists: no test runs them all."""

from __future__ import annotations

import ast
import os
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [
    path
    for folder in ("scripts", "tests")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if not path.name.startswith("test_")
]


def missing(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("trunk_"):
            module = import_module(str(node.module))
            for one in node.names:
                if not hasattr(module, one.name):
                    try:
                        import_module(f"{node.module}.{one.name}")
                    except ImportError:
                        found.append(f"{node.module}.{one.name}")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_its_imports_exist(path: Path) -> None:
    assert missing(path) == []


def test_scripts_with_an_interpreter_line_are_executable() -> None:
    files = [path for path in (ROOT / "scripts").iterdir() if path.is_file()]
    told = [path for path in files if path.read_bytes().startswith(b"#!")]
    assert told
    assert [path.name for path in told if not os.access(path, os.X_OK)] == []
