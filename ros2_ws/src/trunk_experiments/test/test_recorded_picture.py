"""Recordings with a picture: it is there when asked for, and decides nothing."""

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_core import topics
from trunk_evidence.differences import diff
from trunk_evidence.doctor import INFO, findings
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.cli import trunk
from trunk_recording.reader import Recording
from trunk_recording.schemas import deserialize

PICTURES = {"/" + name for name in topics.PICTURES}


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Return a run of fig8 with a picture, repeated from itself, and the same run without one."""
    folder = tmp_path_factory.mktemp("pictures")
    plan = ("simulate", "fig8", "--duration", "1.3", "--set", "simulator.plant.length=0.9")
    for words in (
        (*plan, "--markers", "-o", "first.mcap"),
        (*plan, "-o", "without.mcap"),
        ("simulate", "--like", str(folder / "first.mcap"), "--markers", "-o", "with.mcap"),
    ):
        done = CliRunner().invoke(trunk, [*words[:-1], str(folder / words[-1])])
        assert done.exit_code == 0, done.output
    return folder / "with.mcap", folder / "without.mcap"


@pytest.mark.slow
def test_it_is_recorded_when_asked_for(pair):
    with_picture, without = map(Recording.open, pair)
    assert not PICTURES & without.topics.keys()
    assert with_picture.topics["/markers"].count == with_picture.topics["/tf"].count == 40
    assert with_picture.topics["/robot_description"].count == 1
    ((_, texts),) = with_picture.messages("/robot_description")
    assert 'length="0.9"' in deserialize(topics.STRING_TYPE, texts[0]).data


def test_it_shows_the_states_at_their_times(pair):
    recording = Recording.open(pair[0])
    states = recording.joints("/ground_truth/joint_states")
    for times, messages in recording.messages("/tf"):
        for log_ns, data in zip(times, messages, strict=True):
            hip, trunk = deserialize(topics.TF_TYPE, data).transforms
            row = int(np.searchsorted(states.stamp_ns, log_ns))
            assert states.stamp_ns[row] == log_ns
            x, theta = states.position[row]
            assert hip.transform.translation.x == x
            assert trunk.transform.rotation.y == pytest.approx(np.sin(theta / 2.0))


def test_a_disturbance_is_shown_while_it_acts(pair):
    flashes = set()
    for times, messages in Recording.open(pair[0]).messages("/markers"):
        for log_ns, data in zip(times, messages, strict=True):
            array = deserialize(topics.MARKER_ARRAY_TYPE, data)
            (flash,) = (m for m in array.markers if m.ns == "disturbance/trunk")
            if flash.action == 0:
                flashes.add(round(log_ns / 1e9, 2))
    assert flashes
    assert all(1.0 <= t <= 1.1 for t in flashes)


def test_it_is_covered_by_digests_but_not_judged_and_not_compared(pair, tmp_path):
    verdict = verify(Recording.open(pair[0]))
    assert (verdict.exit_code, verdict.obstacles) == (VERIFIED, [])
    assert "the picture (markers, tf, robot_description): covered by digests alone" in (
        verdict.unjudged
    )
    assert not any("picture" in what for what in verify(Recording.open(pair[1])).unjudged)
    found = diff(*map(RecordedRun.open, pair))
    assert found.identical
    assert found.record == []
    assert all(finding.severity == INFO for finding in findings(RecordedRun.open(pair[0])))


def test_it_is_off_by_default_and_a_parameter_turns_it_on(tmp_path):
    path = tmp_path / "run.mcap"
    words = ["simulate", "fig6", "--duration", "0.1", "--set", "recorder.markers=true", "-o", path]
    assert CliRunner().invoke(trunk, list(map(str, words))).exit_code == 0
    assert Recording.open(path).topics.keys() >= PICTURES
