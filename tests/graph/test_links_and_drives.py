"""Real drives, sensors and links: in lock-step with the offline run's bits; in real time they verify."""

from __future__ import annotations

from pathlib import Path

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.reader import Recording

from .processes import Children

pytestmark = pytest.mark.graph

DRIVE = (
    "simulator.actuator.time_constant=0.02",
    "simulator.actuator.rate_limit=2000",
    "simulator.actuator.dead_band=0.2",
    "simulator.actuator.resolution=0.05",
    "simulator.actuator.bias=-0.3",
    "simulator.actuator.coulomb_friction=0.1",
    "simulator.actuator.viscous_friction=0.05",
    "simulator.sensor.position_resolution=0.001",
    "simulator.sensor.velocity_resolution=0.01",
    "simulator.sensor.position_limit=1.2",
)


LINKS = (
    "simulator.link.state.delay=12ms",
    "simulator.link.state.jitter=10ms",
    "simulator.link.state.loss=0.1",
    "simulator.link.state.order=arrival",
    "simulator.link.command.jitter=5ms",
    "simulator.link.command.jitter_kind=exponential",
    "simulator.link.command.burst.begin=0.03",
    "simulator.link.command.burst.end=0.3",
    "simulator.link.command.duplicates=0.2",
    "simulator.sensor.dropout=0.1",
    "simulator.sensor.position_noise=0.001",
)


@pytest.mark.parametrize("mode", ["lock-step", pytest.param("real time", marks=pytest.mark.long)])
@pytest.mark.parametrize("given", [DRIVE, LINKS], ids=["drive", "links"])
def test_the_nodes_match_the_offline_run(
    children: Children, tmp_path: Path, given: tuple[str, ...], mode: str
) -> None:
    settings = [word for one in given for word in ("--set", one)]
    more = ["--lockstep"] if mode == "lock-step" else []
    run = children.trunk("run", "demo", "--duration", 1.5, "-o", "run", *settings, *more)
    assert run.wait() == 0, run.stderr
    path = tmp_path / "run" / "run.mcap"
    verdict = verify(Recording.open(path))
    assert verdict.exit_code == VERIFIED, verdict.reasons
    if mode == "lock-step":
        offline = tmp_path / "offline.mcap"
        plan = make_plan("demo", "fuzzy_pid", everywhere={"duration": 1.5}, settings=given)
        record_offline(plan, offline)
        found = diff(RecordedRun.open(offline), RecordedRun.open(path))
        assert found.first is None, found.describe()
        told = [RecordedRun.open(one).events for one in (offline, path)]
        counts = [[e.values for e in some if e.message == Event.PASSED_ON] for some in told]
        assert counts[0] == counts[1]
        assert len(counts[0]) == (given is LINKS)
