"""The comparison of batches: MuJoCo agrees first, scikit-fuzzy has our rules. No time is asserted."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest
from benchmarks import lanes
from benchmarks import sweep as bench
from benchmarks.harness import BenchError
from benchmarks.lanes import bench_plan

from trunk_control.fuzzy import infer

ABSENT = "libraries compared against in benchmarks: scripts/bench_libraries.sh"


def test_mujoco_moves_like_our_plant_on_a_flat_path():
    bench.check_mujoco(pytest.importorskip("mujoco", reason=ABSENT))


def test_mujoco_must_agree(monkeypatch):
    mujoco = pytest.importorskip("mujoco", reason=ABSENT)
    monkeypatch.setattr(bench, "MJCF", bench.MJCF.replace("{body.trunk_mass}", "0.51"))
    with pytest.raises(BenchError, match="after 1 s MuJoCo's trunk is at"):
        bench.check_mujoco(mujoco)


def test_scikit_fuzzy_has_our_rules():
    pytest.importorskip("skfuzzy", reason=ABSENT)
    config = bench_plan().controller
    simulation = bench.scikit_simulation(config)
    # At a peak one rule fires alone: its label wins, whatever the defuzzifier.
    for i, j in ((0, 3), (3, 3), (1, 4), (6, 0)):
        e, e_dot = config.rules.error_peaks[i], config.rules.rate_peaks[j]
        simulation.input["e"], simulation.input["e_dot"] = e, e_dot
        simulation.compute()
        for name, ours in zip(("kp", "kd"), infer(e, e_dot, config.rules), strict=False):
            assert round(simulation.output[name]) == ours


@pytest.mark.parametrize(("module", "package"), [("mujoco", "MuJoCo"), ("skfuzzy", "scikit-fuzzy")])
def test_a_missing_library_gives_one_clear_line(monkeypatch, module, package):
    for name in ("mujoco", "skfuzzy"):
        monkeypatch.setitem(sys.modules, name, sys)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BenchError) as caught:
        bench.compare()
    assert str(caught.value) == (
        f"{package} is not installed; install it with: "
        "pip install --no-deps -r requirements/bench.txt"
    )


@pytest.fixture
def short_runs(monkeypatch):
    def plan(name="fuzzy_pid"):
        made = bench_plan(name)
        return replace(made, simulator=replace(made.simulator, duration=0.1))

    for module in (bench, lanes):
        monkeypatch.setattr(module, "bench_plan", plan)
        monkeypatch.setattr(module, "FEW", 16)
    monkeypatch.setattr(lanes, "MANY", 32)


def test_rows(monkeypatch, short_runs):
    pytest.importorskip("mujoco", reason=ABSENT)
    pytest.importorskip("skfuzzy", reason=ABSENT)
    monkeypatch.setattr(bench, "check_mujoco", lambda mujoco: None)
    monkeypatch.setattr(bench, "_STEPS", 100)
    monkeypatch.setattr(bench, "_SCIKIT_STEPS", 2)
    rows = bench.compare(rounds=1)
    assert [row.goal for row in rows] == [">= 250", "", ">= 10000"]
    assert rows[0].ratio == pytest.approx(rows[0].theirs / rows[0].ours)
    assert rows[1].met is None


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_rows_of_lanes(short_runs):
    rows = lanes.compare(rounds=1)
    assert [row.goal for row in rows] == [*[">= 3"] * 5, "", "<= 1.15", "<= 1.3", ">= 1.9"]
    assert [row.name.split(":")[0] for row in rows[:4]] == [
        "PID",
        "Fuzzy-PID",
        "LQR",
        "Computed torque",
    ]
    for row in rows[:4]:
        assert row.ratio == pytest.approx(row.theirs / row.ours)
    for row in rows[5:8]:
        assert row.ratio == pytest.approx(row.ours / row.theirs)
