"""The comparison of batches: MuJoCo agrees first, scikit-fuzzy has our rules. No time is asserted."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from trunk_control.fuzzy import infer
from trunk_experiments.bench import lanes
from trunk_experiments.bench import sweep as bench
from trunk_experiments.bench.lanes import bench_plan
from trunk_experiments.errors import BenchError

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
        bench.bench_sweep()
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
    monkeypatch.setattr(bench, "bench_lanes", lambda rounds: [])
    rows = bench.bench_sweep(rounds=1)
    assert [row.goal for row in rows] == [">= 250", "", ">= 10000"]
    assert rows[0].ratio == rows[0].theirs_s / rows[0].ours_s
    assert rows[1].met is None


@pytest.mark.slow
@pytest.mark.long
def test_rows_of_lanes(short_runs):
    rows = lanes.bench_lanes(rounds=1)
    assert [row.goal for row in rows] == [">= 3"] * 4 + ["<= 1.15", "<= 1.3", ">= 1.9"]
    assert [row.name.split(":")[0] for row in rows[:4]] == [
        "PID",
        "Fuzzy-PID",
        "LQR",
        "Computed torque",
    ]
    for row in rows[:4]:
        assert row.ratio == row.theirs_s / row.ours_s
    for row in rows[4:6]:
        assert row.ratio == row.ours_s / row.theirs_s


def test_rounds_must_be_positive():
    with pytest.raises(ValueError, match="rounds must be 1 or greater, not 0"):
        bench.bench_sweep(rounds=0)
