"""A recorded run reads each part of its file once, whoever asks for it."""

from collections import Counter

import numpy as np
import pytest

from trunk_core import topics
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable
from trunk_recording.reader import Recording
from trunk_views.run_report import make_report
from trunk_views.run_view import RunView

STATE = topics.controller_state("fuzzy_pid")
COLUMNS = (("position", "error"), ("position", "kp"), ("velocity", "nobody"))


@pytest.fixture
def run(short_run):
    return RecordedRun.open(short_run("fig8", "fuzzy_pid"))


@pytest.fixture
def opened(monkeypatch):
    """Count how often each file is opened and each topic is read whole."""
    found = Counter()
    joints, scan = Recording.joints, Recording._opened

    def counted_joints(recording, topic):
        found[topic] += 1
        return joints(recording, topic)

    def counted_scan(recording, progress):
        found["file"] += 1
        return scan(recording, progress)

    monkeypatch.setattr(Recording, "joints", counted_joints)
    monkeypatch.setattr(Recording, "_opened", counted_scan)
    return found


def test_columns_are_the_same_from_the_file_and_from_a_table(run):
    streamed = run.series({STATE: COLUMNS, topics.EFFORT_COMMAND: [("effort", "trunk")]})
    run.table(STATE)
    kept = run.series({STATE: COLUMNS, topics.EFFORT_COMMAND: [("effort", "trunk")]})
    assert list(kept) == list(streamed) == [STATE, topics.EFFORT_COMMAND]
    for topic, series in kept.items():
        assert len(series) > 100
        assert series.stamp_ns.tolist() == streamed[topic].stamp_ns.tolist()
        for column in COLUMNS:
            values = [table.column(*column) for table in (series, streamed[topic])]
            assert values[0].tobytes() == values[1].tobytes()
    assert np.isnan(kept[STATE].column("velocity", "nobody")).all()


def test_a_table_is_read_once_under_either_name(run, opened):
    table = run.table(STATE)
    assert run.joints(STATE) is run.joints(f"/{STATE}") is run.table(STATE) is table
    assert opened == {f"/{STATE}": 1}


def test_a_topic_that_was_not_recorded_is_empty(run):
    assert len(run.joints("nothing/here")) == 0
    assert len(run.series({"nothing/here": [("effort", "trunk")]})["nothing/here"]) == 0


def test_a_report_reads_no_topic_whole_more_than_once(short_run, opened, monkeypatch):
    """For what is shown, for what is wrong, and for the digests: an hour at 1 kHz is large."""
    passes = []
    contents = Recording._contents

    def counted(recording, topics):
        passes.append(list(topics))
        return contents(recording, passes[-1])

    monkeypatch.setattr(Recording, "_contents", counted)
    make_report([RunView.read(RecordedRun.open(short_run("fig8", "fuzzy_pid")))])
    assert set(opened.values()) == {1}
    assert sum(f"/{STATE}" in topics for topics in passes) == 2


def test_metrics_read_no_topic_whole(run, opened):
    RunTable.from_run(run, only=("reference",))
    assert not opened
