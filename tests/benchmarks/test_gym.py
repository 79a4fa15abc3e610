"""The comparison with CartPole, and that the environments' steps are vector code. No time is asserted."""

from __future__ import annotations

import re

import numba
import numpy as np
import pytest
from benchmarks import gym as bench

from trunk_experiments.gym import episodes as kernel
from trunk_experiments.gym.episodes import Episodes
from trunk_experiments.gym.task import make_task
from trunk_msgs_util.compiled import compiled


@pytest.mark.slow
def test_rows(monkeypatch):
    monkeypatch.setattr(bench, "STEPS", 3)
    for row in bench.compare(rounds=1, envs=20):
        assert row.ratio == pytest.approx(row.ours / row.theirs)  # of one round: no median yet
        assert row.goal == ">= 1e+06/s"
        assert row.met == (row.ours >= 1e6)


@pytest.mark.slow
def test_the_plants_steps_are_vector_code():
    episodes = Episodes(make_task("fig8"), 16)
    compiled(kernel.advance)  # registers what it calls
    twin = numba.njit(kernel.advance, error_model="numpy", nogil=True, _nrt=False)
    given = (
        episodes.course,
        episodes._blocks,
        episodes.steps,
        episodes._series,
        episodes._history,
        np.zeros((16, 1)),
    )
    twin.compile(tuple(map(numba.typeof, given)))
    code = "\n".join(twin.inspect_llvm().values())
    assert len(re.findall(r"fdiv <\d+ x double>", code)) >= 8, "two for each stage of a step"
