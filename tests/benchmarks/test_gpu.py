"""The benchmark of a card, with a processor in its place: what is compared agrees. No time is asserted."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from benchmarks import gpu
from ros2_ws.src.trunk_experiments.test.cpp_device import COMPILER, CppDevice

from trunk_experiments.batch.block import Lanes
from trunk_experiments.batch.compiled_run import Batch
from trunk_experiments.batch.kernel import OnDevice

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++"),
]


@pytest.fixture
def device(monkeypatch, tmp_path):
    device = CppDevice(tmp_path)
    monkeypatch.setattr(device, "name", "a processor", raising=False)
    monkeypatch.setattr(gpu, "CudaDevice", lambda: device)
    return device


def test_rows(device, monkeypatch, capsys):
    monkeypatch.setattr(gpu, "ON_CARD", 64)
    monkeypatch.setattr(gpu, "IN_LANES", 32)
    monkeypatch.setitem(sys.modules, "mujoco.mjx", None)
    (lanes,) = gpu.compare(rounds=1)
    assert lanes.name.startswith("a processor, Fuzzy-PID / our lanes on ")
    assert lanes.ratio == pytest.approx(lanes.ours / lanes.theirs)
    assert "without MJX: " in capsys.readouterr().out


def test_both_sides_make_the_same_runs(device):
    ours, theirs = (gpu.made(maker, 40) for maker in (OnDevice(device, Batch()), Lanes(Batch())))
    assert ours.metrics.tobytes() == theirs.metrics.tobytes()
    assert len(np.unique(ours.metric("iae"))) == 40
