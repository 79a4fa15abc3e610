"""Everything except the node shells works without ROS, and everything is installed."""

import subprocess
import sys
from pathlib import Path

import pytest

from trunk_core import PACKAGES

from .finished import finished

SOURCES = Path(__file__).parents[1] / "ros2_ws" / "src"
SHELLS = ("*_node.py", "*/node/*.py")

BLOCKED = """
import importlib, sys

ROS = ("rcl", "rmw", "rosidl", "rosgraph", "ament", "builtin_interfaces", "launch", "ros2")

class WithoutRos:
    def find_spec(self, name, path=None, target=None):
        top = name.split(".")[0]
        if top.startswith(ROS) or top.endswith(("_msgs", "_interfaces", "_srvs")):
            raise ImportError(f"ROS is not installed here: {name}")

sys.meta_path.insert(0, WithoutRos())
sys.path[:0] = sys.argv[1].split(":")
for name in sys.argv[2:]:
    importlib.import_module(name)
"""


def files(package: str) -> list[Path]:
    return sorted((SOURCES / package / package).rglob("*.py"))


def module_name(path: Path) -> str:
    *parents, last = path.relative_to(SOURCES).with_suffix("").parts[1:]
    return ".".join(parents if last == "__init__" else [*parents, last])


PURE = [
    module_name(path)
    for package in PACKAGES
    for path in files(package)
    if path.name != "__main__.py" and not any(path.match(shell) for shell in SHELLS)
]


def import_blocked(*modules: str) -> subprocess.CompletedProcess[str]:
    paths = ":".join(str(SOURCES / package) for package in PACKAGES)
    return finished([sys.executable, "-c", BLOCKED, paths, *modules])


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_modules_import_without_ros_installed(package):
    modules = [name for name in PURE if name.split(".")[0] == package]
    assert modules
    # One interpreter for all is fast; one each only to find out which module fails.
    if import_blocked(*modules).returncode != 0:
        failed = {name: import_blocked(name).stderr.strip().splitlines()[-1:] for name in modules}
        assert {name: error for name, error in failed.items() if error} == {}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_folder_is_a_package(package):
    """Else a build that copies what it installs, as in an image, would leave it out."""
    assert [
        f for f in {path.parent for path in files(package)} if not (f / "__init__.py").is_file()
    ] == []
