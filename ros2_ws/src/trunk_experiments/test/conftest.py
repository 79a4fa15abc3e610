from __future__ import annotations

from dataclasses import replace

import pytest

from trunk_experiments.offline_recording import record_offline
from trunk_experiments.plan import make_plan


@pytest.fixture(scope="session")
def short_run(tmp_path_factory):
    """Return a function that records a short run offline: ``short_run("fig8", "pid", ["file"])``."""
    made = {}

    def run(scenario="fig8", controller="fuzzy_pid", params=(), duration=1.3, settings=()):
        key = (scenario, controller, *params, duration, *settings)
        if key not in made:
            path = tmp_path_factory.mktemp("runs") / f"{scenario}-{controller}.mcap"
            plan = make_plan(scenario, controller, params, settings)
            plan = replace(plan, simulator=replace(plan.simulator, duration=duration))
            record_offline(plan, path)
            made[key] = path
        return made[key]

    return run
