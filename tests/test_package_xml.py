"""Each package.xml declares what the package's code and tests import, and nothing else: packages below it."""

import ast
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from trunk_core import PACKAGES as NAMES

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(path.parent for path in ROOT.glob("ros2_ws/src/*/package.xml"))
ROSDEP = yaml.safe_load((ROOT / "requirements" / "rosdep.yaml").read_text(encoding="utf-8"))
WHEELS = {module for modules in ROSDEP["wheels"].values() for module in modules}
# Called by name: their argument is a module, or where `files` finds a module's data.
CALLS = {"import_module", "importorskip", "files"}
# They run the files in launch/, the tests, an option in pyproject.toml, and the conftest.py of all tests.
TESTING = {"python3-pytest", "python3-pytest-timeout", "python3-hypothesis"}
NO_IMPORT = {"ros2launch"} | TESTING


def modules(text):
    """Return the top-level modules that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(node.module)
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if called in CALLS and not node.args[0].value.startswith("."):
                found.add(node.args[0].value)
    return {name.split(".")[0] for name in found} - sys.stdlib_module_names - {"__future__"}


def keys(package, folders, declared):
    """Return the rosdep keys of what the code in some folders imports, but for what comes as wheels.

    ROS packages have the name that is imported.
    """
    files = [file for folder in folders for file in (package / folder).rglob("*.py")]
    names = set().union(*(modules(file.read_text(encoding="utf-8")) for file in files))
    ros = {key for key in declared if not key.startswith("python3-")} | {p.name for p in PACKAGES}
    return {
        ROSDEP["keys"].get(name) or (name if name in ros else f"python3-{name}")
        for name in names - WHEELS - {package.name}
    }


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_xml_declares_what_is_imported(package):
    root = ElementTree.parse(package / "package.xml").getroot()
    run, test = ({e.text for e in root.findall(tag)} for tag in ("exec_depend", "test_depend"))
    code = keys(package, [package.name, "launch"], run)
    tests = keys(package, ["test"], run | test)
    assert run - NO_IMPORT == code - NO_IMPORT
    assert test - NO_IMPORT == tests - NO_IMPORT - run
    assert test >= TESTING
    assert ("ros2launch" in run) == (package / "launch").is_dir()
    assert (run | test) & {*NAMES} <= {*NAMES[: NAMES.index(package.name)]}


def test_the_packages_are_those_of_the_workspace():
    assert sorted(NAMES) == [package.name for package in PACKAGES]
    lists = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for kept in (
        "packages = [{}",
        "root_packages = [{}]",
        "ancestors = [{}]",
    ):  # of mypy and import-linter
        assert kept.format("".join(f'\n    "{name}",' for name in NAMES) + "\n") in lists
