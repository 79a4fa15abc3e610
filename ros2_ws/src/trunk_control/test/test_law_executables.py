"""A law that setup.py lists has its executable, which starts the node of its name."""

import ast
import re
from pathlib import Path

import pytest

from trunk_control import executables
from trunk_control.laws import REGISTERED, package_of

PACKAGE = Path(__file__).parents[1]


@pytest.mark.parametrize("name", [*REGISTERED, "a_law_to_come"])
def test_it_starts_the_node_of_that_name(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple[str, ...]] = []
    monkeypatch.setattr(executables, "of_law", lambda *name: lambda: started.append(name))
    executables.__getattr__(name)()
    assert started == [(name,)]


def test_private_names_are_not_laws() -> None:
    assert not hasattr(executables, "_law")


def test_setup_py_lists_those_that_are_registered() -> None:
    ours = [name for name in REGISTERED if package_of(name) == "trunk_control"]
    listed = re.search(
        r"^laws = \{.*\n((?: .*\n)+)\}", (PACKAGE / "setup.py").read_text(), re.MULTILINE
    )
    assert listed is not None
    assert list(ast.literal_eval("{" + listed[1] + "}")) == ours
