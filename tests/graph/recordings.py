"""Checks of a recording's file by readers other than our own."""

from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from trunk_core import topics
from trunk_recording.joint_table import JointTable
from trunk_recording.reader import Recording, RecordingError


def finished_file(path: Path) -> Counter[str]:
    """Return the messages by topic of a file with footer, index and sound checksums."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None, "no footer, no summary"
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        assert summary.statistics is not None
        assert summary.statistics.message_count == counts.total()
    return counts


def joints(recording: Recording, topic: str) -> JointTable:
    return recording.joints(f"/{topic}")


def assert_every_step(recording: Recording, period_ns: int, states: int) -> None:
    """Assert that every stamp has its true and its measured state, each once, in order."""
    wanted = np.arange(states) * period_ns
    for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES):
        stamps = joints(recording, topic).stamp_ns
        np.testing.assert_array_equal(stamps, wanted, err_msg=topic)


def states_in(file: Path) -> int:
    """Return how many true states are in the finished chunks of a file that may still grow."""
    try:
        topic = Recording.open(file).topics.get("/ground_truth/joint_states")
    except RecordingError:
        return 0
    return topic.count if topic else 0
