"""Each benchmark runs, briefly; those that compare with other libraries refuse sides that do not agree."""

import sys
from dataclasses import replace

import pytest
from benchmarks import core, gpu, gym, lanes, read, sweep
from ros2_ws.src.trunk_studies.test.cpp_device import COMPILER, CppDevice

from trunk_runs.nodes import CONTROLLERS

pytestmark = pytest.mark.slow


def require(*libraries):
    for name in libraries:
        pytest.importorskip(
            name, reason="libraries compared against in benchmarks: scripts/bench_libraries.sh"
        )


@pytest.fixture
def brief(monkeypatch):
    """Make the runs and batches of batches' benchmarks small."""

    def plan(name="fuzzy_pid", full=lanes.bench_plan):
        made = full(name)
        return replace(made, simulator=replace(made.simulator, duration=0.1))

    for module, name, value in (
        *((module, "bench_plan", plan) for module in (lanes, sweep)),
        *((module, "FEW", 16) for module in (lanes, sweep)),
        *((lanes, "MANY", 32), (sweep, "_STEPS", 100), (sweep, "_SCIKIT_STEPS", 2)),
        *((gpu, "ON_CARD", 64), (gpu, "IN_LANES", 32), (gym, "STEPS", 3)),
    ):
        monkeypatch.setattr(module, name, value)


def goals(rows):
    """Return the goals of rows, each of which says what it measured and whether that is met."""
    assert all(row.ratio > 0.0 and (row.met is None) == (not row.goal) for row in rows)
    return [row.goal for row in rows]


def test_core():
    require("fuzzylite", "simple_pid")
    assert goals(core.compare(rounds=1)) == [">= 2000", "<= 2", "", ""]


def test_read():
    assert goals(read.compare(rounds=1, duration=0.3)) == [">= 15"]


def test_gym(brief):
    assert goals(gym.compare(rounds=1, envs=20)) == [">= 1e+06/s"] * 3


@pytest.mark.one_in(8)
def test_lanes(brief):
    assert goals(lanes.compare(rounds=1)) == [
        *[">= 3" for _ in CONTROLLERS],
        *["", "<= 1.15", "<= 1.3", ">= 1.9"],
    ]


def test_sweep(brief):
    require("mujoco", "skfuzzy")
    assert goals(sweep.compare(rounds=1)) == [">= 250", "", ">= 10000"]


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
def test_gpu(brief, monkeypatch, tmp_path):
    """With a processor in place of the card, and without MuJoCo's."""
    device = CppDevice(tmp_path)
    monkeypatch.setattr(device, "name", "a processor", raising=False)
    monkeypatch.setattr(gpu, "CudaDevice", lambda: device)
    monkeypatch.setitem(sys.modules, "mujoco.mjx", None)
    assert len(goals(gpu.compare(rounds=1))) == 1
