"""Eventful runs are honest all the same: `verify` does not accuse them."""

from __future__ import annotations

from pathlib import Path

import pytest
from std_srvs.srv import Trigger

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import Recording

from .lifecycle import Life
from .peer import Peer
from .processes import Children
from .services import Services

pytestmark = pytest.mark.graph


@pytest.mark.usefixtures("patient")
def test_turns_and_changes_while_the_simulator_is_inactive(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """All of them carry the same stamp: their order decides."""
    truth = peer.hear(topics.GROUND_TRUTH)
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid", "gains.i:=20.0")
    simulator = children.node(
        "simulator", "duration:=0.0", "update_rate:=200.0", "wait_for:=[effort_command,recorder]"
    )
    plant, controller = Life(peer, "simulator"), Life(peer, "pid")
    gains, mechanics = Services(peer, "pid"), Services(peer, "simulator")
    for i_gain in (35.0, 5.0):
        later = len(truth) + 50
        peer.until(lambda later=later: len(truth) > later, "the run goes on")
        assert plant.change("deactivate")
        assert gains.set(gains__i=i_gain).successful
        assert controller.change("deactivate")
        assert gains.set(gains__p=50.0 + i_gain).successful
        assert controller.change("activate")
        assert gains.set(gains__d=3.0 + 0.01 * i_gain).successful
        assert peer.call(Trigger, "/pid/reset").success
        assert gains.set(gains__i=0.5 * i_gain).successful
        assert mechanics.set(plant__length=1.0 + 0.001 * i_gain).successful
        assert peer.call(Trigger, "/simulator/reset").success
        assert plant.change("activate")
    later = len(truth) + 50
    peer.until(lambda: len(truth) > later, "the run goes on")
    for child in (simulator, pid, recorder):
        assert child.stop() == 0, child.stderr
    verdict = verify(Recording.open(tmp_path / "run.mcap"))
    assert verdict.exit_code == VERIFIED, verdict
    parts = "commands of pid", "measured states", "states of the plant", "inputs of the plant"
    assert [(part.name, part.result) for part in verdict.checks] == [
        (name, "verified") for name in parts
    ]


def test_a_second_simulator_is_not_held_against_the_run(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """It is refused, and the run goes on."""
    run = children.trunk(
        *("run", "fig8", "--lockstep", "--speed", 1, "--duration", 10, "--output", "run")
    )
    peer.until_started(run)
    second = children.node("simulator", "lockstep.enabled:=true", "update_rate:=1000.0")
    assert second.wait() == 1, second.stderr
    assert run.wait() == 0, run.stderr
    verdict = verify(Recording.open(tmp_path / "run" / "run.mcap"))
    assert verdict.exit_code == VERIFIED, verdict
