from __future__ import annotations

import pytest

from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.recording.topic_arrays import topic_arrays


def test_joint_states_are_columns(run_file):
    recording = Recording.open(run_file.write(5))
    arrays = topic_arrays(recording, f"/{topics.GROUND_TRUTH}")
    assert arrays["position[trunk]"].tolist() == [k + 0.25 for k in range(6)]
    assert arrays["stamp_ns"].tolist() == [k * run_file.period_ns for k in range(6)]
    assert arrays["log_time_ns"].tolist() == [k * run_file.period_ns + 5 for k in range(6)]
    assert set(topic_arrays(recording, "/effort_command")) == {
        "log_time_ns",
        "stamp_ns",
        "effort[trunk]",
    }


def test_other_messages_are_fields(run_file):
    recording = Recording.open(run_file.write(5))
    arrays = topic_arrays(recording, f"/{topics.RUN_EVENTS}")
    assert arrays["header.stamp.sec"].tolist() == [0]
    assert arrays["header.frame_id"].tolist() == [""]
    assert arrays["status"][0][0].message == "started"
    assert arrays["log_time_ns"].tolist() == [5]


def test_a_missing_topic_is_named(run_file):
    with pytest.raises(RecordingError, match="has no topic /none, only /"):
        topic_arrays(Recording.open(run_file.write(1)), "/none")
