"""Names are nouns: no local, argument or function is called by a pronoun, no docstring begins with one."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PRONOUNS = {"told", "one", "some", "found", "way", "what"}
VAGUE = ("Return what", "Yield what", "Return where", "Yield where")
PACKAGES = ("trunk_msgs_util", "trunk_sim", "trunk_control", "trunk_experiments")


def pronouns(text: str) -> list[str]:
    """Return the names bound by a module's code that are pronouns, and its docstrings that begin so."""
    bound: list[str] = []
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                bound.append(name)
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                bound.append(name)
                bound += [v for v in VAGUE if (ast.get_docstring(node) or "").startswith(v)]
    return [name for name in bound if name in PRONOUNS or name in VAGUE]


@pytest.mark.parametrize("package", PACKAGES)
def test_names_are_nouns(package: str) -> None:
    folder = ROOT / "ros2_ws" / "src" / package / package
    named = {
        str(path.relative_to(folder)): names
        for path in folder.rglob("*.py")
        if (names := pronouns(path.read_text(encoding="utf-8")))
    }
    assert not named


@pytest.mark.parametrize(
    "code",
    ["found = 1", "def f(one): ...", "[x for what in y]", "def told(): ...", "for some in x: ..."],
)
def test_a_pronoun_is_seen(code: str) -> None:
    assert len(pronouns(code)) == 1


def test_a_vague_docstring_is_seen() -> None:
    assert pronouns('def f():\n    "Return what is there."') == ["Return what"]
