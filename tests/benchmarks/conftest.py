"""A short run, recorded offline once."""

from __future__ import annotations

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.offline_recording import record_offline


@pytest.fixture(scope="session")
def short_run(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "fig8.mcap"
    plan = make_plan("fig8", "fuzzy_pid", everywhere={"duration": 1.3})
    record_offline(plan, path)
    return lambda: path
