"""What a recorder missed, and what a stranger sent: judged neither right nor wrong."""

from __future__ import annotations

import struct

import pytest
from trunk_experiments.replay.as_told import not_as_told

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.turns import Swap
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
    assert not any(part.wrong_steps for part in verdict.checks)
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
    assert not any(part.wrong_steps for part in verdict.checks)
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
    assert not any(part.wrong_steps for part in verdict.checks)
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


def counts(messages):
    """Add what each node would have said of its messages at the end of a run in real time."""
    own = {
        "/disturbance": (DISTURBANCE,),
        "/simulator": (TRUTH, STATE),
        "/fuzzy_pid": (COMMAND, "/fuzzy_pid/state"),
    }
    for node, some in own.items():
        say(messages, node, Event.PUBLISHED, **{t: len(of(messages, t)) for t in some})


def say(messages, node, word, **values):
    """Add an event at the end."""
    topic, log_time, _, *rest = of(messages, EVENTS)[-1]
    messages.append([topic, log_time, event(0, node, word, values), *rest])


@pytest.mark.slow
@pytest.mark.parametrize("lost", [50, 1202])
@pytest.mark.parametrize(
    ("end", "said"),
    [(False, (1, 1202)), (False, (1,)), (True, (1, 1202))],
    ids=["incomplete", "without an end", "complete"],
)
def test_a_disturbance_that_the_recorder_never_met_is_missed(whole, tmp_path, lost, end, said):
    """In real time its node may be killed before; another one may follow and be on record."""

    def kill(messages):
        for message in of(messages, DISTURBANCE)[:lost]:
            messages.remove(message)
        for count in said:
            say(messages, "/simulator", "disturbed", disturbances=count)
        say(messages, "/simulator", Event.STOPPED, reason="", states=1201)
        counts(messages)

    path = tmp_path / "killed.mcap"
    verdict = verify(copied(whole, path, kill, ANEW, end, provenance={"mode": "real_time"}))
    if end:  # no recorder of ours calls it complete
        assert any(
            f"disturbance: {1202 - lost} messages, but the simulator took 1202" in reason
            for reason in verdict.reasons
        ), verdict
    else:
        assert verdict.exit_code == UNJUDGED, verdict
        assert not any(part.wrong_steps for part in verdict.checks)
        assert verdict.judged == "no state"


@pytest.mark.parametrize(
    ("mode", "said", "wrong"),
    [
        ("real_time", (), ""),
        ("real_time", (1,), ""),
        ("real_time", (1, 1202), ""),
        ("real_time", (1, 7, 7), ""),  # it failed, and was stopped
        ("real_time", (2,), "of 2, where it must be 1"),
        ("real_time", (1, 1), "of 1, where it must be 2 or more"),
        ("real_time", (1, 11, 8), "of 8, where it must be 11 or more"),
        ("real_time", (1, 9), "of 9, not at the end of the run"),
        ("real_time", ("many",), "of 'many', where it must be 1"),
        ("real_time", ("9" * 5000,), "of '999999999999...9999999999999', where it must be 1"),
        ("real_time", (1, 1203), "1202 messages, but the simulator took 1203"),
        ("lockstep", (1,), "of 1 in a run in simulated time"),
    ],
)
def test_the_simulator_can_say_only_such_counts(whole, tmp_path, mode, said, wrong):
    def edit(messages):
        for count in said:
            say(messages, "/simulator", "disturbed", disturbances=count)
            if count not in (1, 9):
                say(messages, "/simulator", Event.STOPPED, reason="", states=1201)

    copied(whole, tmp_path / "a.mcap", edit, ANEW, provenance={"mode": mode})
    run = RecordedRun.open(tmp_path / "a.mcap")
    told = [event for event in run.events if event.node == "/simulator"]
    found = [line for line in not_as_told(run, "simulator", told) if "disturb" in line]
    assert [wrong in line for line in found] == [True] * bool(wrong), found


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 600])
def test_terms_that_the_recorder_lost_are_missed(whole, tmp_path, first):
    """In real time their controller said how many it published; without them no command can be checked."""

    def lose(messages):
        counts(messages)
        for message in of(messages, "/fuzzy_pid/state")[first : first + 5]:
            messages.remove(message)

    path = tmp_path / "lost.mcap"
    verdict = verify(copied(whole, path, lose, ANEW, False, provenance={"mode": "real_time"}))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.checks)
    assert verdict.judged.startswith("t = 0 to 0.599 s" if first else "no state"), verdict


@pytest.mark.slow
@pytest.mark.parametrize("topic", [COMMAND, "/pid/state"])
def test_the_last_words_of_a_killed_controller_may_be_missing_although_another_followed(
    tmp_path, topic
):
    """In real time the recorder may lack its last commands or terms, and has those of the next one."""
    swaps = [Swap(0.1, "fuzzy_pid")]
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.3}, swaps=swaps)
    record_offline(plan, tmp_path / "whole.mcap")

    def kill(messages):
        told = of(messages, EVENTS)
        (last,) = [m for m in told if b"/pid" in m[2] and Event.DEACTIVATED.encode() in m[2]]
        messages.remove(last)
        own = {TRUTH: 301, STATE: 301}
        say(messages, "/simulator", Event.PUBLISHED, **own)
        own = {COMMAND: 201, "/fuzzy_pid/state": 201}
        say(messages, "/fuzzy_pid", Event.PUBLISHED, **own)
        for message in of(messages, topic)[95:100]:
            messages.remove(message)

    path = tmp_path / "killed.mcap"
    source, provenance = tmp_path / "whole.mcap", {"mode": "real_time"}
    verdict = verify(copied(source, path, kill, ANEW, False, provenance=provenance))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.checks)
    assert verdict.judged.startswith("t = 0 to 0.094 s"), verdict


@pytest.mark.parametrize("end", [True, False], ids=["complete", "incomplete"])
def test_commands_before_any_controllers_events_are_not_attributed(whole, tmp_path, end):
    """Theirs was killed before the recorder had its events; the next one did not say how many it gave."""

    def edit(messages):
        topic, log_time, _, *rest = of(messages, EVENTS)[-1]
        joined = event(300_000_000 - 1, "/fuzzy_pid", Event.ACTIVATED)
        messages.append([topic, log_time, joined, *rest])

    path = tmp_path / "a.mcap"
    verdict = verify(copied(whole, path, edit, ANEW, end, provenance={"mode": "real_time"}))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.checks)
    assert any("what follows t = 0 s is not judged" in line for line in verdict.obstacles)


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
    assert not any(part.wrong_steps for part in verdict.checks)
    assert "t = 0 to 0.59" in verdict.judged or "t = 0 to 0.6 s" in verdict.judged
    assert any("what follows t = 0.6 s" in o or "t = 0.599 s" in o for o in verdict.obstacles)
    run = RecordedRun.open(tmp_path / "stranger.mcap")
    assert explain(run, 0.5).controller == "fuzzy_pid"
    with pytest.raises(RecordingError, match="on no command can be traced"):
        explain(run, 0.61)
