"""What is run before a release, briefly: it does what it says, and leaves nothing behind."""

import json
import re
import sys
from pathlib import Path

import pytest
from benchmarks.nodes import MEASURES

from .processes import Child, Children

pytestmark = pytest.mark.graph

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "scripts"


def module(children: Children, *words: object) -> Child:
    """Start a module from the project's root."""
    return children.start("module", "env", "-C", ROOT, sys.executable, "-m", *words)


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_bad_arguments_lose_nothing_and_get_one_line(children: Children) -> None:
    """Some twenty; `python -m tests.hostile.arguments` tries all with every verb, `trunk run` among them."""
    run = module(children, "tests.hostile.arguments", "--every", 397)
    assert run.wait() == 0, run.stdout + run.stderr
    cases = run.stdout.splitlines()[-1]
    assert cases.endswith(", 0 wrong")
    assert int(cases.split()[0]) >= 19


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_soak_of_a_quarter_of_a_minute(children: Children) -> None:
    """At 1 kHz, so that a publisher already keeps its 5000 messages when its memory is first measured."""
    # On a busy machine a recorder may be up to 5000 messages of each topic behind, half a minute or an
    # hour after its start: a tenth of its memory, and no leak.
    given = ("--minutes", 0.25, "--rate", 1000, "--growth", 0.15)
    # On a machine that busy, nodes that end wait longer for those that have yet to hear from them.
    check = (sys.executable, SCRIPTS / "check_soak.py", *given)
    soak = children.start("soak", "env", "TRUNK_PATIENCE=4", *check)
    assert soak.wait() == 0, soak.stdout + soak.stderr
    children.none_left()
    for node in ("simulator", "disturbance", "fuzzy_pid", "recorder"):
        assert f"  {node} " in soak.stdout
    assert "15001 states" in soak.stdout
    assert soak.stdout.splitlines()[-1] == "check_soak: 0.25 min at 1000 Hz passed"


@pytest.mark.one_in(8)
def test_two_honest_runs(children: Children) -> None:
    check = module(children, "tests.honest.check", 2, "--workers", 2, "--busy", 1)
    assert check.wait() == 0, check.stdout + check.stderr
    last = check.stdout.splitlines()[-1]
    assert re.fullmatch(r"2 honest runs: .* 0 diverge, 0 falsely complete", last), last


SHORT = ("--rate", 100, "--seconds", 0.5, "--rounds", 1)


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_benchmark_of_nodes(children: Children) -> None:
    child = module(children, "benchmarks", "realtime", *SHORT, "--json")
    assert child.wait() in (0, 1), child.stderr  # 1: a goal was missed, on a busy machine
    children.none_left()
    rows = [row["name"] for row in json.loads(child.stdout)["rows"]]
    loops = ("pid", "fuzzy_pid", "fuzzy_pid, recorder")
    assert rows == [f"{loop}: {one}" for loop in loops for one in MEASURES]


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_node_of_somebody_elses_beside_ours(children: Children) -> None:
    pd = ROOT / "examples" / "nodes" / "pd_rclpy.py"
    child = module(children, "benchmarks", "external", f"{sys.executable} {pd}", *SHORT)
    assert child.wait() == 0, child.stderr
    children.none_left()
    measures = ("late steps", "lock-step, steps/s", "latency, median", "unanswered states")
    for measure in measures:
        assert len([line for line in child.stdout.splitlines() if measure in line]) == 1
    assert "/my_pd" in child.stderr
