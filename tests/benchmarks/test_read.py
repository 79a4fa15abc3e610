"""The comparison itself: agreement first, then times. No time is asserted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks import read as bench


def test_row(short_run):
    (row,) = bench.compare(rounds=1, run=str(short_run()))
    assert row.name.startswith("6506 ")  # 1301 steps, five topics; one disturbance ahead
    assert row.ratio == pytest.approx(row.theirs / row.ours)
    assert row.met == (row.ratio >= 15.0)


def test_arrays_must_be_equal(short_run, monkeypatch):
    true = bench.ours

    def off(path):
        arrays = true(path)
        effort = arrays["/effort_command"].effort.copy()
        effort[7] = np.nextafter(effort[7], 0.0)
        return {**arrays, "/effort_command": replace(arrays["/effort_command"], effort=effort)}

    monkeypatch.setattr(bench, "ours", off)
    with pytest.raises(bench.BenchError, match="/effort_command: rosbags reads other"):
        bench.compare(rounds=1, run=str(short_run()))
