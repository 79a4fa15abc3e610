"""A table filled in passing equals one that is read whole; its values may be read in windows."""

import sys

import numpy as np
import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_evidence import in_force
from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording import writer
from trunk_recording.cdr import layout_of
from trunk_recording.reader import Recording
from trunk_runs import engine
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from ...trunk_recording.test.mcap_files import write_mcap

QUANTITIES = ("position", "velocity", "effort")
TERMS = topics.controller_state("pid")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "CHUNK_SIZE", 20_000)  # some twenty states
        record_offline(make_plan("fig8", "pid", everywhere={"duration": 0.3}), path)
    return path


@pytest.fixture
def filled(path):
    return RecordedRun.open(path, whole=True)


@pytest.mark.parametrize(
    "relative",
    [
        topics.GROUND_TRUTH,
        topics.JOINT_STATES,
        topics.EFFORT_COMMAND,
        topics.DISTURBANCE,
        TERMS,
    ],
)
def test_tables_filled_in_passing_are_those_read_one_by_one(relative, filled, path):
    there, read = filled.table(relative), RecordedRun.open(path).table(relative)
    assert there.names == read.names
    for quantity in QUANTITIES:
        assert there.width(quantity) == read.width(quantity)
    assert there.stamp_ns.tolist() == read.stamp_ns.tolist() == there.log_time_ns.tolist()
    assert (there.frames, there.frame.tolist()) == (read.frames, read.frame.tolist())
    for quantity in QUANTITIES:
        assert there.values(quantity).tobytes() == read.values(quantity).tobytes()


def test_equal_stamps_share_their_memory(filled):
    truth, terms = filled.table(topics.GROUND_TRUTH), filled.table(TERMS)
    assert truth.stamp_ns is terms.stamp_ns is terms.log_time_ns


@pytest.mark.parametrize(
    "spans", [[(0, 301)], [(0, 7), (7, 90), (85, 230), (300, 301), (3, 9), (9, 9)]]
)
def test_windows_of_values_that_were_not_kept(spans, filled, path):
    table = filled.table(TERMS)
    whole = RecordedRun.open(path).table(TERMS).values("position")
    for first, stop in spans:
        assert table.positions(first, stop).tobytes() == whole[first:stop].tobytes()
    assert table.again is not None  # nothing has read it whole


@pytest.mark.slow
def test_a_verified_run_is_never_read_whole(path, monkeypatch):
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: True)
    run = RecordedRun.open(path, whole=True)
    assert verdict_on(run).exit_code == VERIFIED
    assert run.table(TERMS).again is not None


def test_terms_of_several_layouts_are_read_when_they_are_needed(tmp_path):
    samples = [JointSample(k, (f"term{k % 2}",), (float(k),)) for k in range(9)]
    messages = [("/a/state", s.stamp_ns, layout_of(s).pack(s)) for s in samples]
    recording = Recording.open(write_mcap(tmp_path / "a.mcap", messages), whole=True)
    assert not recording.filled()
    assert recording.joints("/a/state").names == ("term0", "term1")


def test_digests_made_while_a_file_is_read_are_those_made_alone(path):
    assert Recording.open(path, whole=True).digested == Recording.open(path).digested


def test_without_a_compiler_a_run_is_judged_all_the_same(path, monkeypatch):
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: True)
    monkeypatch.setattr(in_force, "_WORTH_COMPILING", 0)
    monkeypatch.setattr(in_force, "twin", lambda function: function)
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.delitem(sys.modules, "trunk_core.compiled", raising=False)
    assert verdict_on(RecordedRun.open(path)).exit_code == VERIFIED


def test_rows_are_found_by_stamp(path):
    table = RecordedRun.open(path).table(topics.GROUND_TRUTH)
    assert [table.row(stamp) for stamp in (0, 299_000_000, 300_000_000)] == [0, 299, 300]
    assert [table.row(stamp) for stamp in (-1, 500_000, 301_000_000)] == [None] * 3
    assert table.rows_of(np.array([2_000_000, 5, 1_000_000])).tolist() == [2, -1, 1]


def test_whoever_judges_a_run_reads_it_in_one_pass(path, filled):
    run = RecordedRun.open(path)
    assert verdict_on(run).exit_code == VERIFIED
    assert run.recording.digested == filled.recording.digested
    assert run.table(TERMS).again is not None  # its values were not kept
