"""A simulator that is started again finds the others ready: time begins anew for all of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, copied

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_msgs_util.recording.reader import Recording

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

COMMANDS = f"/{topics.EFFORT_COMMAND}"
TOPICS = "[effort_command, disturbance]"


def test_two_runs_with_the_same_others(children: Children, peer: Peer) -> None:
    disturbances = peer.hear(topics.DISTURBANCE)
    others = [children.node("pid", "lockstep.enabled:=true"), children.node("disturbance")]
    for run in (1, 2):
        simulator = children.node(
            "simulator", "duration:=1.0", "lockstep.enabled:=true", f"wait_for:={TOPICS}",
            name=f"simulator_{run}",
        )  # fmt: skip
        # In lock-step it ends only where every state was answered by both.
        assert simulator.wait() == 0, simulator.stderr
        peer.until(lambda run=run: len(disturbances) == 202 * run, "each state has its disturbance")
    stamps = [stamp_from_ros(m.header.stamp) for m in disturbances]
    assert stamps[:202] == stamps[202:] == [5_000_000 * k for k in range(202)]
    for node in others:
        assert node.stop() == 0, node.stderr


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("second", [pytest.param("pid", marks=pytest.mark.long), "fuzzy_pid"])
def test_a_controller_that_takes_the_place_of_one_that_ended(
    children: Children, peer: Peer, tmp_path: Path, second: str
) -> None:
    """The run goes on, and either is judged and held to what it published: each message says whose it is."""
    recorder = children.node("recorder", "output:=run.mcap")
    simulator = children.node("simulator", "duration:=0.0")
    first = children.node("pid")
    peer.until_recorded(500)
    assert first.stop() == 0, first.stderr
    updates = peer.hear(topics.controller_state(second))
    before = len(updates)
    other = children.node(second, name="second")
    peer.until(lambda: len(updates) > before + 100, "the other one answers")
    assert [one.stop() for one in (simulator, other, recorder)] == [0, 0, 0]
    recording = Recording.open(tmp_path / "run.mcap")
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    again = "commands of pid, process 2" if second == "pid" else f"commands of {second}"
    assert [check.name for check in verdict.checks[:2]] == ["commands of pid", again]
    counts = {
        event.source: int(event.values[COMMANDS])
        for event in recording.events()
        if event.message == "published" and COMMANDS in event.values
    }
    assert [check.steps for check in verdict.checks[:2]] == list(counts.values())
    assert min(counts.values()) > 0
    ended, begun = verdict.checks[0].until_ns, verdict.checks[1].from_ns
    assert ended is not None
    assert begun is not None
    assert ended < begun
    states = recording.joints(f"/{topics.GROUND_TRUTH}").stamp_ns
    assert [check.steps for check in verdict.checks[2:]] == [len(states)] * 3
    for source in counts:

        def without_one(messages: list[list], source: str = source) -> None:
            own = [m for m in messages if m[0] == COMMANDS and f"\0{source}\0".encode() in m[2]]
            messages.remove(own[len(own) // 2])

        found = verify(copied(tmp_path / "run.mcap", tmp_path / "edited.mcap", without_one, ANEW))
        count = f"{counts[source] - 1} of {counts[source]} messages were recorded"
        assert any(count in line for line in found.contradictions), found.reasons
