"""Two runs that differ only in how often a stamp appears."""

from __future__ import annotations

import pytest

from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.writer import RecordingWriter
from trunk_msgs_util.samples import JointSample

MS = 1_000_000


def run(path, *messages):
    """Record (stamp in ms, torque) as commands; a bare stamp is its own torque."""
    with RecordingWriter(path) as writer:
        channel = writer.channel(f"/{topics.EFFORT_COMMAND}", topics.JOINT_STATE_TYPE)
        for message in messages:
            stamp, torque = message if isinstance(message, tuple) else (message, message)
            sample = JointSample(stamp * MS, ("trunk",), effort=(float(torque),))
            writer.write(channel, stamp * MS, stamp * MS, layout_of(sample).pack(sample))
    return RecordedRun.open(path)


CASES = {
    "doubled in A": ((0, 1, 1, 2), (0, 1, 2), 1, (1.0, None)),
    "doubled in B": ((0, 1, 2), (0, 1, 2, 2), 2, (None, 1.0)),
    "three times against twice": ((0, 1, 1, 1, 2), (0, 1, 1, 2), 1, (1.0, None)),
    "as many, but of other stamps": ((0, 1, 1, 2), (0, 1, 2, 2), 1, (1.0, None)),
    "the second of a stamp": ((0, (1, 5.0), (1, 6.0)), (0, (1, 5.0), (1, 7.0)), 1, (6.0, 7.0)),
}


@pytest.mark.parametrize(("a", "b", "stamp", "values"), CASES.values(), ids=CASES)
def test_every_message_of_a_stamp_counts(tmp_path, a, b, stamp, values):
    found = diff(run(tmp_path / "a.mcap", *a), run(tmp_path / "b.mcap", *b))
    assert not found.identical
    assert found.first.stamp_ns == stamp * MS
    assert (found.first.a, found.first.b) == values
    assert found.first.topic == topics.EFFORT_COMMAND


def test_equal_doubled_stamps_do_not_differ(tmp_path):
    stamps = (0, 1, 1, 2, (2, 7.0))
    found = diff(run(tmp_path / "a.mcap", *stamps), run(tmp_path / "b.mcap", *stamps))
    assert found.identical
    assert (found.compared, found.differing_steps) == (5, 0)
