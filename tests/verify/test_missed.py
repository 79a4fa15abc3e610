"""What a recorder missed, and what a stranger sent: judged neither right nor wrong."""

from __future__ import annotations

import struct

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.doctor import examine
from trunk_experiments.replay.explain import explain
from trunk_experiments.replay.verify import UNJUDGED, verify
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.recording.schemas import event

from ..edited import ANEW, copied
from .messages import COMMAND, DISTURBANCE, STATE, TRUTH, of


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "last", "judged"),
    [(0.0, 0.5, "no state"), (0.5, 0.7, "t = 0 to 0.499 s, 500 states, offline")],
)
def test_what_a_recorder_missed_is_judged_neither_right_nor_wrong(
    whole, tmp_path, first, last, judged
):
    """A recorder that starts after more messages than publishers keep, or that cannot keep up for a while."""

    def miss(messages):
        for topic in (COMMAND, STATE, TRUTH, DISTURBANCE, "/fuzzy_pid/state"):
            for message in of(messages, topic):
                sec, nanosec = struct.unpack_from("<iI", message[2], 4)
                if first <= sec + 1e-9 * nanosec < last:
                    messages.remove(message)

    verdict = verify(copied(whole, tmp_path / "late.mcap", miss, ANEW, end=False))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.parts)
    assert verdict.judged == judged
    run = RecordedRun.open(tmp_path / "late.mcap")
    with pytest.raises(RecordingError, match=f"from t = {first:g} s on no command can be traced"):
        explain(run, last + 0.1)
    told = [f.message for f in examine(tmp_path / "late.mcap") if "steps are missing" in f.message]
    assert len(told) >= 4, told  # true and measured states, commands, disturbances, terms


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("topic", [COMMAND, "/fuzzy_pid/state"])
@pytest.mark.parametrize("lost", [1, 2, 5])
def test_the_last_answers_of_a_killed_controller_may_be_missing_in_part(
    whole, tmp_path, topic, lost
):
    """Commands and terms come on separate topics: the recorder may lack several of either."""

    def kill(messages):
        for message in of(messages, topic)[-lost:]:
            messages.remove(message)

    path = tmp_path / "killed.mcap"
    verdict = verify(copied(whole, path, kill, ANEW, end=False, provenance={"mode": "lockstep"}))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.parts)
    assert verdict.judged.startswith("t = 0 to 1.19")


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("lost", [1, 2, 5])
def test_the_last_terms_of_a_controller_killed_after_the_end_may_be_missing(whole, tmp_path, lost):
    """In lock-step a run is complete without them: the states and commands are all there."""

    def kill(messages):
        for message in of(messages, "/fuzzy_pid/state")[-lost:]:
            messages.remove(message)

    path = tmp_path / "killed.mcap"
    verdict = verify(copied(whole, path, kill, ANEW, provenance={"mode": "lockstep"}))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.parts)
    assert verdict.judged.startswith(f"t = 0 to {1.2 - 0.001 * lost:g} s")
    (obstacle,) = verdict.obstacles
    assert obstacle.startswith("fuzzy_pid did not say how many messages it published")


@pytest.mark.slow
@pytest.mark.parametrize("update_rate", [1000, 250])
def test_a_controller_that_outlives_the_recorder_is_judged_to_the_end(tmp_path, update_rate):
    settings = [f"fuzzy_pid.update_rate={update_rate}"]
    plan = make_plan("fig8", "fuzzy_pid", settings=settings, everywhere={"duration": 0.303})
    record_offline(plan, tmp_path / "offline.mcap")
    provenance = {"mode": "lockstep"}
    source, path = tmp_path / "offline.mcap", tmp_path / "run.mcap"
    verdict = verify(copied(source, path, digests=ANEW, provenance=provenance))
    assert not verdict.obstacles, verdict
    assert verdict.judged.startswith("t = 0 to 0.303 s, 304 states")


EVENTS = "/run/events"


@pytest.mark.slow
@pytest.mark.parametrize("lost", [50, 1202])
@pytest.mark.parametrize("end", [False, True], ids=["incomplete", "complete"])
def test_a_disturbance_that_the_recorder_never_met_is_missed(whole, tmp_path, end, lost):
    """In real time its node may be killed before; another one may follow and be on record."""

    def kill(messages):
        told = of(messages, DISTURBANCE)
        for message in told[:lost]:
            messages.remove(message)
        counts = [("/disturbance", (DISTURBANCE,))]
        counts += [("/simulator", (TRUTH, STATE)), ("/fuzzy_pid", (COMMAND, "/fuzzy_pid/state"))]
        said = [("/simulator", Event.DISTURBED, {"disturbances": len(told)})]
        said += [
            (node, Event.PUBLISHED, {t: len(of(messages, t)) for t in own}) for node, own in counts
        ]
        _, log_time, _, *rest = of(messages, EVENTS)[-1]
        messages += [[EVENTS, log_time, event(0, *one), *rest] for one in said]

    path = tmp_path / "killed.mcap"
    verdict = verify(copied(whole, path, kill, ANEW, end, provenance={"mode": "real_time"}))
    if end:  # no recorder of ours calls it complete
        assert any(
            f"disturbance: {1202 - lost} messages, but the simulator took 1202" in reason
            for reason in verdict.reasons
        ), verdict
    else:
        assert verdict.exit_code == UNJUDGED, verdict
        assert not any(part.wrong_steps for part in verdict.parts)
        assert verdict.judged == "no state"


WALL = struct.pack("<iI", 1_795_000_000, 0)


def again(messages, topic, row, stamp):
    """Put a copy of a message behind it, with another stamp: a stranger's."""
    message = list(of(messages, topic)[row])
    at = messages.index(of(messages, topic)[row])
    message[2] = message[2][:4] + (stamp or message[2][4:12]) + message[2][12:]
    messages.insert(at + 1, message)


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("topic", [STATE, TRUTH, COMMAND, DISTURBANCE])
@pytest.mark.parametrize("stamp", [WALL, None], ids=["wall clock", "doubled"])
def test_a_stranger_is_not_taken_for_a_node_of_ours(whole, tmp_path, topic, stamp):
    """The run is judged up to its first message; the recorder has marked it as incomplete."""
    copy = copied(
        whole,
        tmp_path / "stranger.mcap",
        lambda m: again(m, topic, 600, stamp),
        ANEW,
        end=False,
        provenance={"mode": "real_time"},
    )
    verdict = verify(copy)
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.parts)
    assert "t = 0 to 0.59" in verdict.judged or "t = 0 to 0.6 s" in verdict.judged
    assert any("what follows t = 0.6 s" in o or "t = 0.599 s" in o for o in verdict.obstacles)
    run = RecordedRun.open(tmp_path / "stranger.mcap")
    assert explain(run, 0.5).controller == "fuzzy_pid"
    with pytest.raises(RecordingError, match="on no command can be traced"):
        explain(run, 0.61)
