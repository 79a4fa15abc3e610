"""A recording to be edited, judged by compiled code and by CPython."""

from dataclasses import replace

import pytest

from trunk_runs import engine
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan


@pytest.fixture(autouse=True, params=["CPython", "compiled"])
def engine_kind(request, monkeypatch):
    """Judge every file with both: 1201 rows are several windows."""
    compiled = request.param == "compiled"
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: compiled)
    monkeypatch.setattr(engine, "longest", lambda _: 300)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("verify") / "whole.mcap"
    plan = make_plan("fig8", "fuzzy_pid")
    plan = replace(plan, simulator=replace(plan.simulator, duration=1.2, position_noise=1e-3))
    record_offline(plan, path)
    return path
