"""An operator's pushes on record: by a stranger, too strong, between two states, or altered."""

from dataclasses import replace
from math import nan

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_core import topics
from trunk_evidence.judgement import DIVERGES, UNJUDGED, VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_sim.inputs import Applied

from .messages import of

PUSH = f"/{topics.OPERATOR_PUSH}"
PUSHES = ((50_000_000, Applied(0.0, 30.0)), (150_000_000, Applied(0.0, -30.0)))


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """Return the recording of a run in which somebody pushed twice."""
    path = tmp_path_factory.mktemp("pushed") / "run.mcap"
    everywhere = {"duration": 0.6, "operator.torque": 30.0}
    plan = make_plan("fig8", "pid", settings=(), everywhere=everywhere)
    record_offline(replace(plan, pushes=PUSHES), path)
    return path


def verdict_of(pushed, path, edit):
    return verify(copied(pushed, path, edit, ANEW))


def test_it_verifies(pushed):
    assert verify(Recording.open(pushed)).exit_code == VERIFIED
    assert Recording.open(pushed).topics[PUSH].count == 2


def put(messages, row, **efforts):
    """Write other efforts, or another stamp, into a push; an effort is a double at the message's end."""
    import struct

    message = list(of(messages, PUSH))[row]
    data = bytearray(message[2])
    for place, value in efforts.items():
        end = {"torque": len(data) - 8, "force": len(data) - 16}.get(place)
        if end is None:
            struct.pack_into("<iI", data, 4, 0, value)
        else:
            struct.pack_into("<d", data, end, value)
    message[2] = bytes(data)


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "edit",
    [
        lambda m: put(m, 0, torque=29.999999999),
        lambda m: put(m, 0, stamp=51_000_000),
        lambda m: put(m, 0, stamp=50_500_000),
        lambda m: m.remove(list(of(m, PUSH))[1]),
        lambda m: [m.remove(one) for one in list(of(m, PUSH))],
    ],
    ids=["weaker", "later", "between", "one_gone", "both_gone"],
)
def test_what_was_altered_diverges(pushed, tmp_path, edit):
    verdict = verdict_of(pushed, tmp_path / "edited.mcap", edit)
    assert verdict.exit_code == DIVERGES, verdict.reasons


def test_a_push_that_is_no_number_is_an_obstacle(pushed, tmp_path):
    verdict = verdict_of(pushed, tmp_path / "edited.mcap", lambda m: put(m, 1, torque=nan))
    assert verdict.exit_code == UNJUDGED
    assert any("operator/push: not as a simulator writes it" in line for line in verdict.obstacles)


@pytest.mark.parametrize(("row", "beyond"), [(0, {"force": 1.0}), (1, {"torque": -31.0})])
def test_what_is_beyond_the_operators_limits_is_not_shown(pushed, tmp_path, row, beyond):
    edited = copied(pushed, tmp_path / "edited.mcap", lambda m: put(m, row, **beyond), ANEW)
    assert verify(edited).exit_code == VERIFIED
    assert RecordedRun(edited).operated.pushes == RecordedRun.open(pushed).operated.pushes


def again(messages):
    """Repeat the first push, as a stranger's node may."""
    first = next(iter(of(messages, PUSH)))
    messages.insert(messages.index(first) + 1, list(first))


def test_a_strangers_push_accuses_nobody(pushed, tmp_path):
    """The recorder has marked the file as incomplete."""
    verdict = verify(copied(pushed, tmp_path / "stranger.mcap", again, ANEW, end=False))
    assert verdict.exit_code == UNJUDGED, verdict.reasons
