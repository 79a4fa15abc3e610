"""A second simulator and recorder on another host end before they take part; the first run stays whole."""

from pathlib import Path

import pytest

from trunk_runs.plan import make_plan

from .hosts import Host
from .listener import Listener
from .runs import SpreadRun

pytestmark = [pytest.mark.graph, pytest.mark.slow]


@pytest.mark.parametrize(
    "lockstep",
    [True, pytest.param(False, marks=pytest.mark.one_in(8))],
    ids=["lock-step", "real time"],
)
def test_the_older_nodes_go_on(
    hosts: tuple[Host, Host], listener: Listener, tmp_path: Path, lockstep: bool
) -> None:
    a, b = hosts
    settings = ["simulator.lockstep.speed=1.0"] if lockstep else []
    everywhere = {"duration": 10.0, "update_rate": 200.0}
    if lockstep:
        everywhere |= {"lockstep.enabled": True}
    plan = make_plan("fig8", "fuzzy_pid", settings=settings, everywhere=everywhere)
    run = SpreadRun(plan, tmp_path)
    run.start(a, "recorder", "fuzzy_pid", "disturbance", "simulator")
    listener.until_states(200)
    again = tmp_path / "again"
    again.mkdir()
    second = SpreadRun(plan, again)
    second.start(b, "recorder", "simulator")
    code, said = second.simulator_ends()
    assert code == 1
    assert "another /simulator is running, in process " in said
    code, said = second.ends("recorder")
    assert code == 1
    assert "another /recorder is running, in process " in said
    assert run.simulator_ends()[0] == 0
    run.stop_all()
    found = run.recording()
    assert found.complete, found.warnings
