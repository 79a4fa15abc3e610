"""Each package.xml declares what the package's code and tests import, and nothing else."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(path.parent for path in ROOT.glob("ros2_ws/src/*/package.xml"))
OWN = {path.name for path in PACKAGES}
ROSDEP = yaml.safe_load((ROOT / "requirements" / "rosdep.yaml").read_text(encoding="utf-8"))
LIST_OF = {module: name for name, modules in ROSDEP["wheels"].items() for module in modules}
DISTRIBUTIONS = {
    "cupy": "cupy-cuda12x",
    "axe_playwright_python": "axe-playwright-python",
    "fuzzylite": "pyfuzzylite",
    "skfuzzy": "scikit-fuzzy",
}
# Called by name: their argument is a module, or where `files` finds a module's data.
CALLS = {"import_module", "importorskip", "files"}
NO_IMPORT = {
    "ros2launch": "runs the files in launch/",
    "python3-pytest": "runs the tests",
    "python3-pytest-timeout": "an option in pyproject.toml",
    "python3-hypothesis": "the conftest.py of all tests",
}


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


def imported(package, *folders):
    files = [file for folder in folders for file in (package / folder).rglob("*.py")]
    found = set().union(*(modules(file.read_text(encoding="utf-8")) for file in files))
    return found - {package.name}


def ros_packages(manifest):
    """Return the declared keys that are ROS packages: they have the name that is imported."""
    return {key for key in manifest if not key.startswith("python3-")}


def keys(names, declared):
    """Return the rosdep keys of modules, without those that come as wheels."""
    found = set()
    for name in names - set(LIST_OF):
        own = name in ros_packages(declared) or name in OWN
        found.add(ROSDEP["keys"].get(name) or (name if own else f"python3-{name}"))
    return found


def declared_by(package):
    """Return what package.xml declares for the code, and for the tests."""
    root = ElementTree.parse(package / "package.xml").getroot()
    return tuple({e.text for e in root.findall(tag)} for tag in ("exec_depend", "test_depend"))


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_xml_declares_what_is_imported(package):
    run, test = declared_by(package)
    code = keys(imported(package, package.name, "launch"), run)
    tests = keys(imported(package, "test"), run | test)
    assert code - run == set()
    assert tests - run - test == set()
    assert (run | test) - code - tests - set(NO_IMPORT) == set()
    assert run - code - set(NO_IMPORT) == set(), "declared for the code, used by tests alone"
    assert run & test == set()
    assert {"python3-pytest", "python3-pytest-timeout", "python3-hypothesis"} <= test
    assert ("ros2launch" in run) == (package / "launch").is_dir()


def test_the_test_sees_an_import():
    text = "def f():\n    import a.b\n    from c import d\n    from .e import g\n    import_module('h.i')"
    assert modules(text) == {"a", "c", "h"}


@pytest.mark.slow
def test_what_rosdep_does_not_know_is_locked_and_used():
    used = set().union(*(imported(p, p.name, "launch", "test") for p in PACKAGES))
    for file in (
        ROOT / "conftest.py",
        *ROOT.glob("benchmarks/*.py"),
        *ROOT.glob("tests/benchmarks/*.py"),
    ):
        used |= modules(file.read_text(encoding="utf-8"))
    for module, name in LIST_OF.items():
        lock = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
        assert f"\n{DISTRIBUTIONS.get(module, module)}==" in f"\n{lock}"
    assert set(LIST_OF) | set(ROSDEP["keys"]) <= used


def test_packages_do_not_depend_on_each_other_in_a_circle():
    """Colcon orders them by what their tests need, too."""
    left = {path.name: set().union(*declared_by(path)) & OWN for path in PACKAGES}
    while left:
        free = {name for name, needed in left.items() if not needed & set(left)}
        assert free, left
        left = {name: needed for name, needed in left.items() if name not in free}


def test_one_maintainer_of_all_packages():
    found = {
        (e.text, e.get("email"))
        for path in PACKAGES
        for e in ElementTree.parse(path / "package.xml").findall("maintainer")
    }
    assert len(found) == 1
