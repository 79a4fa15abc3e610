"""The benchmark in real time runs and shows every row. No time is asserted."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from benchmarks.nodes import LATENCY, MEASURES

from .processes import Child, Children

pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.long]

PD = Path(__file__).parents[2] / "examples" / "nodes" / "pd_rclpy.py"
LOOPS = ("pid", "fuzzy_pid", "fuzzy_pid, recorder")


def bench(children: Children, *words: object) -> Child:
    """Start a benchmark from the project's root."""
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "benchmarks", *map(str, words)]
    return children.start("bench", "env", "-C", root, *command)


SHORT = ("--rate", 100, "--seconds", 0.5, "--rounds", 1)


def test_every_row(children: Children) -> None:
    child = bench(children, "realtime", *SHORT, "--json")
    assert child.wait() in (0, 1), child.stderr  # 1: a goal was missed, on a busy machine
    children.none_left()
    assert child.stdout, child.stderr
    rows = json.loads(child.stdout)["rows"]
    assert [row["name"] for row in rows] == [f"{loop}: {one}" for loop in LOOPS for one in MEASURES]
    for row in rows:
        if row["name"].endswith(LATENCY):
            assert row["ours"] > 0.0
            assert row["ratio"] == pytest.approx(row["ours"] / row["theirs"])
            assert (row["goal"], row["met"]) == ("<= 1.3", row["ratio"] <= 1.3)


def test_a_wrong_rate_is_refused_by_name(children: Children) -> None:
    child = bench(children, "realtime", "--rate", 0)
    assert child.wait() == 2
    assert "'--rate'" in child.stderr


def test_a_node_of_somebody_elses_beside_ours(children: Children) -> None:
    child = bench(children, "external", f"{sys.executable} {PD}", *SHORT)
    assert child.wait() == 0, child.stderr
    children.none_left()
    measures = ("late steps", "lock-step, steps/s", "latency, median", "unanswered states")
    for measure in measures:
        assert len([line for line in child.stdout.splitlines() if measure in line]) == 1
    assert "/my_pd" in child.stderr
