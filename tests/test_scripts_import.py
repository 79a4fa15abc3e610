"""What scripts, and the checks among the tests, import from the packages exists: no test runs them all."""

import ast
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_imports_exist() -> None:
    files = [path for folder in ("scripts", "tests") for path in (ROOT / folder).rglob("*.py")]
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("trunk_"):
                module = import_module(str(node.module))
                for name in (alias.name for alias in node.names):
                    if not hasattr(module, name):
                        import_module(f"{node.module}.{name}")
