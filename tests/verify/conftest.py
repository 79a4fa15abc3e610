"""A recording to be edited, judged in both ways that `verify` has."""

from __future__ import annotations

from dataclasses import replace

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.replay import replay, stretches
from trunk_experiments.runs.offline_recording import record_offline


@pytest.fixture(autouse=True, params=["step by step", "by stretches"])
def way(request, monkeypatch):
    """Judge every file in both ways: all in detail, and with compiled code for equal stretches."""
    if request.param == "by stretches":
        monkeypatch.setattr(replay, "WORTH_COMPILING", 0)
        monkeypatch.setattr(stretches, "LONGEST", 300)  # of 1201 rows: several windows


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("verify") / "whole.mcap"
    plan = make_plan("fig8", "fuzzy_pid")
    plan = replace(plan, simulator=replace(plan.simulator, duration=1.2, position_noise=1e-3))
    record_offline(plan, path)
    return path
