from __future__ import annotations

import csv
from math import inf

import numpy as np
import pyarrow.parquet as pq
import pytest

from trunk_experiments.analysis.run_table import CSV_COLUMNS, RunTable
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.views.extract import COLUMNS, window, write_mcap, write_npz, write_parquet
from trunk_msgs_util.recording.reader import Recording, RecordingError

TRUTH = "/ground_truth/joint_states"


@pytest.fixture(scope="module")
def run(short_run):
    return Recording.open(short_run("fig8", "fuzzy_pid"))


@pytest.fixture(scope="module")
def table(run):
    return RunTable.from_run(RecordedRun(run))


def test_tables_hold_the_same_bits(table, tmp_path):
    part = window(table, 0.2, 0.9)
    assert (part.t[0], part.t[-1], len(part.t)) == (0.2, 0.9, 701)
    write_parquet(part, tmp_path / "a")
    write_npz(part, tmp_path / "b")
    part.write_csv(tmp_path / "c")
    parquet, npz = pq.read_table(tmp_path / "a"), np.load(tmp_path / "b")
    with (tmp_path / "c").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(parquet.column_names) == tuple(npz) == COLUMNS == (*CSV_COLUMNS, "alpha")
    for name in COLUMNS:
        expected = getattr(part, name).tobytes()
        assert parquet[name].to_numpy().tobytes() == expected
        assert npz[name].tobytes() == expected
    assert [float(row["torque"]) for row in rows] == part.torque.tolist()
    assert len(window(table).t) == 1301


def test_a_part_is_copied_byte_for_byte(run, tmp_path):
    path = tmp_path / "part.mcap"
    count = write_mcap(run, path, 0.5, 0.6, ["joint_states", "/run/parameters", "/run/events"])
    part = Recording.open(path)
    ((log, data),) = part.messages("/joint_states")
    whole = {t: m for block in run.messages("/joint_states") for t, m in zip(*block, strict=True)}
    assert log == [k * 1_000_000 for k in range(500, 601)]
    assert data == [whole[t] for t in log]
    assert count == 101 + len(run.parameters())
    assert part.parameters() == run.parameters()  # set before, and still holding
    assert part.provenance == run.provenance
    assert part.events() == []
    assert not part.complete
    assert "t = 0.5 to 0.6 s" in part.end["reason"]


@pytest.mark.parametrize(
    ("start", "end", "topics", "said"),
    [
        (-inf, 1.0, (), ", up to t = 1 s, 8 topics"),
        (0.5, inf, (), ", from t = 0.5 s, 8 topics"),
        (-inf, inf, ("joint_states",), ", 1 topics"),
    ],
)
def test_an_open_end_is_not_mentioned(run, tmp_path, start, end, topics, said):
    write_mcap(run, tmp_path / "part.mcap", start, end, topics)
    reason = Recording.open(tmp_path / "part.mcap").end["reason"]
    assert reason == f"exported from {run.path.name}{said}"


def test_the_whole_run_is_copied_complete_and_unchanged(run, tmp_path):
    path = tmp_path / "all.mcap"
    assert write_mcap(run, path) == sum(topic.count for topic in run.topics.values())
    copy = Recording.open(path)
    assert copy.complete
    assert copy.joints(TRUTH).position.tobytes() == run.joints(TRUTH).position.tobytes()


def test_an_unknown_topic_is_named(run, tmp_path):
    with pytest.raises(RecordingError, match="has no topic /states, only "):
        write_mcap(run, tmp_path / "a.mcap", topics=["states"])
    assert not (tmp_path / "a.mcap").exists()
