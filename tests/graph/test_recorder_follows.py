"""A recorder that is given no names records whoever answers, and the file can be judged."""

from __future__ import annotations

from pathlib import Path

import pytest

from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.reader import Recording

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph


def test_a_renamed_controller_is_recorded_from_its_first_update(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    recorder = children.node("recorder", "output:=run.mcap")
    peer.until_event("recorder", Event.ACTIVATED)
    controller = children.node("pid", "-r", "__node:=balance")
    peer.until_event("balance", Event.ACTIVATED)
    simulator = children.node("simulator", "duration:=0.5", "wait_for:=[effort_command, recorder]")
    assert simulator.wait() == 0, simulator.stderr
    assert controller.stop() == 0, controller.stderr
    assert recorder.stop() == 0, recorder.stderr
    counts = {
        name: topic.count for name, topic in Recording.open(tmp_path / "run.mcap").topics.items()
    }
    assert counts["/balance/state"] == counts["/effort_command"] > 0
    assert not any("fuzzy_pid" in name for name in counts)
