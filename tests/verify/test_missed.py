"""What a recorder missed, and what a stranger sent: judged neither right nor wrong."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_evidence.doctor import findings
from trunk_evidence.explanation import explain
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.repetition import plan_of
from trunk_recording.reader import Recording, RecordingError
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from .. import real_time
from ..real_time import in_frame, record_real_time
from .messages import COMMAND, DISTURBANCE, STATE, TRUTH, of, without


@pytest.fixture(scope="module")
def in_real_time(tmp_path_factory):
    path = tmp_path_factory.mktemp("missed") / "run.mcap"
    record_real_time(make_plan("demo", "pid", everywhere={"duration": 1.0}), path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "last", "judged"),
    [
        (0.0, 0.5, "t = 0.5 to 1.2 s, 701 states, offline"),
        (0.5, 0.7, "t = 0 to 1.2 s, 1001 states, offline"),
    ],
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
    with pytest.raises(RecordingError, match="what it follows from, are not all on record"):
        explain(run, last + 0.1)
    told = [
        f.message
        for f in findings(RecordedRun.open(tmp_path / "late.mcap"))
        if "steps are missing" in f.message
    ]
    assert len(told) >= 4, told  # true and measured states, commands, disturbances, terms


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("topic", [COMMAND, "/fuzzy_pid/state"])
@pytest.mark.parametrize("lost", [1, 2, 5])
def test_the_last_answers_of_a_killed_controller_may_be_missing_in_part(
    whole, tmp_path, topic, lost
):
    """Commands and terms come on separate topics: the recorder may lack several of either."""

    kill, path = without(slice(-lost, None), topic), tmp_path / "killed.mcap"
    verdict = verify(copied(whole, path, kill, ANEW, end=False, provenance={"mode": "lockstep"}))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(part.wrong_steps for part in verdict.checks)
    assert verdict.judged == "t = 0 to 1.2 s, 1201 states, in lock-step"
    (commands,) = (check for check in verdict.checks if check.name == "commands of fuzzy_pid")
    assert commands.steps == 1201 - (lost if topic == COMMAND else 0)


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("lost", [1, 2, 5])
def test_the_last_terms_of_a_controller_killed_after_the_end_may_be_missing(tmp_path, lost):
    """In lock-step a run is complete without them: the states and commands are all there."""
    everywhere = {"duration": 0.3, "lockstep.enabled": True}
    source, path = tmp_path / "whole.mcap", tmp_path / "killed.mcap"
    record_offline(make_plan("fig8", "fuzzy_pid", everywhere=everywhere), source)

    def kill(messages):
        real_time.configure(messages, "simulator", "disturbance", "fuzzy_pid")
        without(slice(-lost, None), "/fuzzy_pid/state")(messages)

    verdict = verify(copied(source, path, kill, ANEW, provenance={"mode": "lockstep"}))
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(check.wrong_steps for check in verdict.checks)
    missing = f"t = {0.3 - 0.001 * (lost - 1):g} s: fuzzy_pid/state: no message with this stamp"
    assert verdict.obstacles == [missing]


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


def test_a_state_that_a_controller_missed_is_no_turn_in_a_repetition(in_real_time, tmp_path):
    """It acted all the time, and kept its memory."""
    plan = plan_of(RecordedRun.open(in_real_time))
    given, missed = plan.inputs, [40, 41, 90]
    command_ns, answered = given.command_ns.copy(), given.answered["pid"]
    rows = np.flatnonzero(np.isin(command_ns, answered[missed]))
    command_ns[rows] = answered[39]
    for row in rows[rows > 60]:
        command_ns[row] = command_ns[row - 1]
    given = replace(given, command_ns=command_ns, answered={"pid": np.delete(answered, missed)})
    record_offline(replace(plan, inputs=given), tmp_path / "again.mcap")
    verdict = verify(Recording.open(tmp_path / "again.mcap"))
    assert verdict.exit_code == VERIFIED, verdict
    assert [check.steps for check in verdict.checks if check.name == "commands of pid"] == [198]


WALL = struct.pack("<iI", 1_795_000_000, 0)


def again(messages, topic, row, stamp):
    """Put a copy of a message behind it, with another stamp, and return it."""
    message = list(of(messages, topic)[row])
    at = messages.index(of(messages, topic)[row])
    message[2] = message[2][:4] + (stamp or message[2][4:12]) + message[2][12:]
    messages.insert(at + 1, message)
    return message


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("topic", [STATE, TRUTH, COMMAND, DISTURBANCE])
@pytest.mark.parametrize("stamp", [WALL, None], ids=["wall clock", "doubled"])
def test_a_stranger_is_not_taken_for_a_node_of_ours(in_real_time, tmp_path, topic, stamp):
    """Its messages have no source of ours: the whole run is judged without them."""

    def edit(messages):
        message = again(messages, topic, 60, stamp)
        message[2] = in_frame(message[2], "")
        real_time.number(messages)

    copy = copied(in_real_time, tmp_path / "stranger.mcap", edit, ANEW, end=False)
    verdict = verify(copy)
    assert verdict.exit_code == UNJUDGED, verdict
    assert not any(check.wrong_steps for check in verdict.checks)
    assert {check.steps for check in verdict.checks} == {201, 202}
    run = RecordedRun.open(tmp_path / "stranger.mcap")
    assert explain(run, 0.9).controller == "pid"
