"""The services of simulator and controller, called in a run that is recorded and then verified."""

import time
from math import pi
from pathlib import Path

import pytest
from std_srvs.srv import SetBool, Trigger

from trunk_evidence.judgement import VERIFIED, verify
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_recording.reader import Recording

from .peer import Event, Peer
from .processes import Children
from .recordings import assert_every_step, joints
from .services import Services

pytestmark = [pytest.mark.graph, pytest.mark.virtual]

PERIOD_NS = 5_000_000
START = pi / 6.0  # rad, the initial angle


@pytest.mark.usefixtures("patient")
def test_reset_and_pause_in_a_run(children: Children, peer: Peer, tmp_path: Path) -> None:
    truth = peer.hear("ground_truth/joint_states")
    terms = peer.hear("pid/state")
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid", "reference.value:=0.25")
    simulator = children.node("simulator", "duration:=0.0", "wait_for:=[effort_command, recorder]")

    def angles() -> dict[int, float]:
        return {stamp_from_ros(m.header.stamp): m.position[1] for m in truth}

    def resets() -> list[Event]:
        return [e for e in peer.events if (e.node, e.message) == ("/simulator", "reset")]

    # The plant's reset: the initial state at once, while time goes on. The trunk may have swung back to its
    # initial angle by then, however long that took: then ask again.
    away = 0.0
    while away < 0.2:
        peer.until(
            lambda: truth and abs(truth[-1].position[1] - START) > 0.25, "the trunk has moved"
        )
        before = len(resets())
        response = peer.call(Trigger, "/simulator/reset")
        assert response.success
        assert "initial state" in response.message
        peer.until(lambda before=before: len(resets()) > before, "the reset is reported")
        reset_ns = resets()[-1].stamp_ns
        assert reset_ns > 0
        after_ns = reset_ns + PERIOD_NS
        peer.until(lambda at=after_ns: at in angles(), "time goes on")
        # One step of 5 ms from rest: less than 0.01 rad even at full torque.
        assert angles()[after_ns] == pytest.approx(START, abs=0.01)
        away = abs(angles()[reset_ns] - START)

    # Pause: no state follows the last one until the run is resumed.
    response = peer.call(SetBool, "/simulator/pause", data=True)
    assert (response.success, response.message) == (True, "paused")
    paused_ns = peer.until_event("simulator", "paused").stamp_ns
    peer.until(lambda: paused_ns in angles(), "the last state before the pause")
    peer.until(lambda: peer.last_diagnostics("simulator")["state"] == "paused", "it says so")
    assert peer.fresh_diagnostics("simulator")["state"] == "paused"  # more than a second later
    assert max(angles()) == paused_ns

    resumed_s = time.monotonic()
    response = peer.call(SetBool, "/simulator/pause", data=False)
    assert (response.success, response.message) == (True, "running")
    assert peer.until_event("simulator", "resumed").stamp_ns == paused_ns
    peer.until(lambda: paused_ns + 20 * PERIOD_NS in angles(), "states go on")
    # The next tick comes within a period of the resumption: states may be ahead by as much.
    ahead_s = (max(angles()) - paused_ns - PERIOD_NS) / 1e9
    assert ahead_s <= time.monotonic() - resumed_s, "the time of the pause was made up for"

    # The controller's reset: the integral starts afresh at the next state.
    peer.until(lambda: terms and abs(terms[-1].position[5]) > 0.5, "the integral has grown")
    response = peer.call(Trigger, "/pid/reset")
    assert response.success
    forgot_ns = peer.until_event("pid", "reset").stamp_ns
    first = peer.until(
        lambda: [m for m in terms if stamp_from_ros(m.header.stamp) > forgot_ns],
        "the controller goes on",
    )[0]
    values = dict(zip(first.name, first.position, strict=True))
    assert abs(values["i_term"]) <= values["ki"] * abs(values["error"]) * 2 * PERIOD_NS / 1e9

    for child in (simulator, pid, recorder):
        assert child.stop() == 0, child.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.complete, recording.warnings
    assert_every_step(recording, PERIOD_NS, len(joints(recording, "joint_states")))
    told = [(event.node, event.message) for event in recording.events("/run/events")]
    for message in ("started", "reset", "paused", "resumed", "finished"):
        assert ("/simulator", message) in told
    assert ("/pid", "reset") in told
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict


def test_pause_and_reset_before_the_start(children: Children, peer: Peer) -> None:
    simulator = children.node("simulator")
    response = peer.call(SetBool, "/simulator/pause", data=True)
    assert (response.success, response.message) == (False, "waiting for participants")
    response = peer.call(Trigger, "/simulator/reset")
    assert response.success
    assert response.message == "the plant is in its initial state before the first state"
    assert simulator.stop() == 0


@pytest.mark.usefixtures("patient")
def test_a_pause_outlives_the_inactive_state(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    truth = peer.hear("ground_truth/joint_states")
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid")
    simulator = children.node("simulator", "duration:=0.0")
    peer.until_recorded(100)  # a recorder that came after this run would hold none of its states
    assert peer.call(SetBool, "/simulator/pause", data=True).success
    paused_ns = peer.until_event("simulator", "paused").stamp_ns
    life = Services(peer, "simulator")
    assert life.change("deactivate")
    response = peer.call(SetBool, "/simulator/pause", data=False)
    assert (response.success, response.message) == (False, "inactive: activate the simulator")
    assert life.change("activate")
    assert peer.fresh_diagnostics("simulator")["state"] == "paused"
    assert peer.call(SetBool, "/simulator/pause", data=False).success
    peer.until(lambda: stamp_from_ros(truth[-1].header.stamp) > paused_ns, "it goes on")
    # Cleaned up, the run is over: the record says where, and a new one begins at its first state.
    assert life.change("deactivate")
    assert life.change("cleanup")
    over = peer.until_event("simulator", "finished")
    assert over.stamp_ns >= paused_ns
    recorded = int(peer.fresh_diagnostics("recorder")["messages"])
    assert life.change("configure")
    assert life.change("activate")
    peer.until(lambda: stamp_from_ros(truth[-1].header.stamp) < over.stamp_ns, "time begins anew")
    peer.until_recorded(recorded + 100)  # more than the events: states of the new run, too
    assert [simulator.stop(), pid.stop(), recorder.stop()] == [0, 0, 1]
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.warnings == ["incomplete: it holds 2 runs: the simulator was restarted"]
