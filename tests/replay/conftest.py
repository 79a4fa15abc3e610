"""Each test of the replay runs in every way; short runs to replay."""

from __future__ import annotations

from dataclasses import replace

import pytest

from trunk_experiments.plans.timeline import Change
from trunk_msgs_util.events import Event
from trunk_sim.operator_input import Applied

from .runs import LINKS, MS, SENSORS, planned, recorded
from .ways import WAYS, replay_this_way

PUSHES = ((13 * MS, Applied(3.0, 5.0)), (20 * MS, Applied(0.0, -4.0)), (40 * MS, Applied(2.0, 0.0)))
CHANGES = {
    "simulator": [
        Change(25 * MS, {"sensor.velocity_bias": 0.2, "plant.length": 1.1}),
        Change(45 * MS, None, Event.RESET),
    ]
}


@pytest.fixture(autouse=True, params=WAYS)
def way(request, monkeypatch):
    replay_this_way(request.param, monkeypatch)
    return request.param


@pytest.fixture(scope="module")
def linked(tmp_path_factory):
    plan = replace(planned(*SENSORS, *LINKS), changes=CHANGES)
    return recorded(plan, tmp_path_factory.mktemp("replay") / "linked.mcap")


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """Return a run that somebody pushes, each time for 10 ms; nothing delays or hides what acts."""
    limits = {"operator.force": 10.0, "operator.torque": 10.0, "operator.timeout": 0.01}
    plan = replace(planned(**limits), pushes=PUSHES)
    return recorded(plan, tmp_path_factory.mktemp("replay") / "pushed.mcap")
