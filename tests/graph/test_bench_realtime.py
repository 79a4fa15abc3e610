"""The benchmark in real time runs and shows every row. No time is asserted."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from trunk_experiments.bench.realtime import LATENCY, MEASURES

from .processes import Children

pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.long]

PD = Path(__file__).parents[2] / "examples" / "nodes" / "pd_rclpy.py"
LOOPS = ("bare pair", "pid", "fuzzy_pid", "fuzzy_pid, recorder")


def test_every_row(children: Children) -> None:
    bench = children.trunk(
        "bench", "realtime", "--rate", 100, "--seconds", 0.5, "--rounds", 1, "--json"
    )
    assert bench.wait() in (0, 1), bench.stderr  # 1: a goal was missed, on a busy machine
    children.none_left()
    assert bench.stdout, bench.stderr
    rows = json.loads(bench.stdout)["rows"]
    assert [(row["loop"], row["measure"]) for row in rows] == [
        (loop, measure) for loop in LOOPS for measure in MEASURES
    ]
    latencies = {row["loop"]: row for row in rows if row["measure"] == LATENCY}
    bare = latencies["bare pair"]
    assert (bare["ratio"], bare["goal"], bare["met"]) == (1.0, "", None)
    for loop in LOOPS[1:]:
        row = latencies[loop]
        assert row["value"] > 0.0
        assert row["ratio"] == pytest.approx(row["value"] / bare["value"])
        assert row["met"] == (row["ratio"] <= 1.3)
        assert row["goal"] == "<= 1.3"


def test_a_wrong_rate_is_refused_by_name(children: Children) -> None:
    bench = children.trunk("bench", "realtime", "--rate", 0)
    assert bench.wait() == 2
    *_, line = bench.stderr.splitlines()
    assert "'--rate'" in line
    assert "0.0 is not in the range" in line


def test_a_node_of_somebody_elses_beside_ours(children: Children) -> None:
    bench = children.trunk(
        "bench",
        "external",
        f"{sys.executable} {PD}",
        "--rate",
        100,
        "--seconds",
        0.5,
        "--rounds",
        1,
    )
    assert bench.wait() == 0, bench.stderr
    children.none_left()
    measures = ("late steps", "lock-step, steps/s", "latency, median", "unanswered states")
    for measure in measures:
        assert len([line for line in bench.stdout.splitlines() if measure in line]) == 2
    assert "/my_pd" in bench.stderr
