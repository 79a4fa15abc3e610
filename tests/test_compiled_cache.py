"""Compiled code is kept on disk, by one process at a time."""

from __future__ import annotations

import fcntl

import pytest
from numba.core.caching import IndexDataCacheFile

from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.simulation import Simulation


@pytest.mark.slow
def test_one_process_at_a_time_adds_to_the_cache_of_compiled_code(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    save = IndexDataCacheFile.save
    saved = []

    def watched(file, key, data):
        (path,) = tmp_path.rglob("lock")
        with path.open() as lock, pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        saved.append(key)
        save(file, key, data)

    monkeypatch.setattr(IndexDataCacheFile, "save", watched)
    Simulation(SimulatorConfig(duration=1e6)).step(0.0, Disturbance())
    assert saved
