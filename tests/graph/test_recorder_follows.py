"""A recorder that is given no names records whoever answers, and the file can be judged."""

from __future__ import annotations

from pathlib import Path

import pytest

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.reader import Recording

from .peer import Peer
from .processes import Child, Children

pytestmark = pytest.mark.graph


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("lockstep", ["false", "true"])
def test_nodes_of_any_name_are_recorded_and_judged(
    children: Children, peer: Peer, tmp_path: Path, lockstep: str
) -> None:
    def start(executable: str, name: str, *more: str) -> Child:
        mode = f"lockstep.enabled:={lockstep}"
        return children.node(executable, "-r", f"__node:={name}", mode, *more)

    recorder = start("recorder", "tape", "output:=run.mcap")
    peer.until_event("tape", Event.ACTIVATED)
    controller = start("pid", "balance")
    peer.until_event("balance", Event.ACTIVATED)
    simulator = start("simulator", "plant", "duration:=0.5", "wait_for:=[effort_command, recorder]")
    assert simulator.wait() == 0, simulator.stderr
    assert controller.stop() == 0, controller.stderr
    assert recorder.stop() == 0, recorder.stderr
    counts = {
        name: topic.count for name, topic in Recording.open(tmp_path / "run.mcap").topics.items()
    }
    assert counts["/balance/state"] == counts["/effort_command"] > 0
    assert not any("fuzzy_pid" in name for name in counts)
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.complete, recording.warnings
    assert recording.controllers == ["pid"]  # goes by what it is
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict
    assert verdict.parts[0].name == "commands of pid"
    assert "pid is the node /balance" in verdict.notes
    explained = children.trunk("explain", "run.mcap", "--at", "0.1", name="explain")
    assert explained.wait() == 0, explained.stderr
