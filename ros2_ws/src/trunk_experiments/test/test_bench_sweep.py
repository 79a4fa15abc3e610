"""The comparison of batches: MuJoCo agrees first, scikit-fuzzy has our rules. No time is asserted."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from trunk_control.fuzzy import infer
from trunk_experiments.bench import sweep as bench
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
    config = bench.bench_plan().controller
    simulation = bench.scikit_simulation(config)
    # At a peak one rule fires alone: its label wins, whatever the defuzzifier.
    for i, j in ((0, 3), (3, 3), (1, 4), (6, 0)):
        e, e_dot = config.rules.error_peaks[i], config.rules.rate_peaks[j]
        simulation.input["e"], simulation.input["e_dot"] = e, e_dot
        simulation.compute()
        for name, ours in zip(("kp", "kd"), infer(e, e_dot, config.rules), strict=False):
            assert round(simulation.output[name]) == ours


@pytest.mark.parametrize(("module", "package"), [("mujoco", "MuJoCo"), ("skfuzzy", "scikit-fuzzy")])
def test_a_missing_library_is_one_clear_line(monkeypatch, module, package):
    for name in ("mujoco", "skfuzzy"):
        monkeypatch.setitem(sys.modules, name, sys)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BenchError) as caught:
        bench.bench_sweep()
    assert str(caught.value) == (
        f"{package} is not installed; it comes with: "
        "pip install --no-deps -r requirements/bench.txt"
    )


def test_rows(monkeypatch):
    pytest.importorskip("mujoco", reason=ABSENT)
    pytest.importorskip("skfuzzy", reason=ABSENT)
    plan = bench.bench_plan()
    short = replace(plan, simulator=replace(plan.simulator, duration=0.1))
    monkeypatch.setattr(bench, "bench_plan", lambda: short)
    monkeypatch.setattr(bench, "check_mujoco", lambda mujoco: None)
    monkeypatch.setattr(bench, "_STEPS", 100)
    monkeypatch.setattr(bench, "_SCIKIT_STEPS", 2)
    rows = bench.bench_sweep(rounds=1)
    assert [row.goal for row in rows] == [">= 40", "", ">= 10000", "<= 1.15", ">= 1.8"]
    assert rows[0].ratio == rows[0].theirs_s / rows[0].ours_s
    assert rows[1].met is None
    assert rows[3].ratio == rows[3].ours_s / rows[3].theirs_s


def test_rounds_must_be_positive():
    with pytest.raises(ValueError, match="rounds must be 1 or greater, not 0"):
        bench.bench_sweep(rounds=0)
