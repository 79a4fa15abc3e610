"""What a verb imports before it answers: nothing that it does not use."""

import subprocess
import sys

import pytest

from trunk_runs.processes import find_executable

HEAVY = {"matplotlib", "numba", "pandas", "pyarrow", "rclpy", "rosbags", "scipy", "yaml", "jinja2"}
HEAVY |= {"importlib.metadata", "rich.console", "rich.progress", "email", "asyncio"}


def imported(*words: object) -> set[str]:
    """Return the modules that the installed command imports, as Python itself lists them."""
    trunk = find_executable("trunk_experiments", "trunk")
    done = subprocess.run(
        [sys.executable, "-X", "importtime", str(trunk), *map(str, words)],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("import time:")]
    found = {line.rpartition("|")[2].strip() for line in lines}
    assert {"click", "trunk_experiments.cli"} <= found
    return found


def test_the_overview_imports_click_and_no_verb():
    found = imported("--help")
    assert not found & (HEAVY | {"numpy", "difflib", "trunk_evidence"})
    shared = {name for name in found if name.startswith("trunk_experiments.console.")}
    assert shared == {
        f"trunk_experiments.console.{name}" for name in ("document", "terminal", "verbs")
    }


def test_metrics_import_numpy_and_neither_plan_nor_plant_nor_law(short_run):
    found = imported("metrics", short_run("fig6", "fuzzy_pid"))
    assert "numpy" in found
    assert not found & (HEAVY | {"trunk_sim", "trunk_runs", "trunk_control.law"})


@pytest.mark.parametrize("words", [("params", "pid"), ("params", "--json")], ids=" ".join)
def test_a_list_of_parameters_imports_no_middleware(words):
    found = imported(*words)
    used = {"yaml", "importlib.metadata", "email"}  # laws are found among the installed packages
    assert not found & (HEAVY - used | {"trunk_runs.plan"})
