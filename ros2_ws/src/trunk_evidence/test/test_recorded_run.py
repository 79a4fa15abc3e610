"""The names, the controllers and the parameters of a run, by what its recording says."""

import pytest

from trunk_core import topics
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording import schemas
from trunk_recording.writer import RecordingWriter

from ...trunk_recording.test.conftest import RunFile

TRUTH = f"/{topics.GROUND_TRUTH}"


def test_a_namespace_is_found(tmp_path):
    run = RecordedRun.open(RunFile(tmp_path).write(2, namespace="/a/b"))
    assert run.namespace == "/a/b"
    assert run.topic("joint_states") == "/a/b/joint_states"
    assert (run.controller, run.controllers) == ("pid", ("pid",))
    assert len(run.table(topics.GROUND_TRUTH)) == 3
    assert run.topic("/elsewhere") == "/elsewhere"


def test_initial_parameters_and_changes_are_kept_apart(tmp_path):
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        channel = writer.channel("/run/parameters", topics.PARAMETER_EVENT_TYPE)
        for stamp_ns, new, changed in (
            (0, {"gains.p": 1.0}, {}),
            (7, {}, {"gains.p": 2.0}),
            (9, {"gains.p": 3.0}, {}),  # the node came anew
        ):
            data = schemas.parameter_event(stamp_ns, "/pid", new, changed)
            writer.write(channel, stamp_ns, stamp_ns, data)
    run = RecordedRun.open(path)
    assert run.first_sets == {"/pid": {"gains.p": 1.0}}
    assert [(c.stamp_ns, c.changed) for c in run.parameter_changes("pid")] == [
        (7, {"gains.p": 2.0})
    ]


@pytest.mark.parametrize(
    ("named", "renamed"),
    [
        (["/plant"], {"simulator": "plant"}),
        (["/simulator"], {}),
        (["/plant", "/other"], {}),  # which of them?
        (["/plant", "/simulator"], {}),
    ],
)
@pytest.mark.parametrize("told", ["configured", "activated"])
def test_a_node_goes_by_its_kind_where_no_other_has_that_name(tmp_path, named, renamed, told):
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        channel = writer.channel("/run/events", topics.DIAGNOSTIC_ARRAY_TYPE)
        writer.channel(TRUTH, topics.JOINT_STATE_TYPE)
        for name in named:
            kind = {"process": "1", "kind": "simulator"}
            # A node that has its name need not even say so.
            word, values = (told, {}) if name == "/simulator" else ("configured", kind)
            writer.write(channel, 0, 0, schemas.event(-1, name, word, values))
    run = RecordedRun.open(tmp_path / "a.mcap")
    assert run.renamed == renamed
    assert run.relative("/plant/state") == ("simulator/state" if renamed else "plant/state")
