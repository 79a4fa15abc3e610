import csv
from dataclasses import replace

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_evidence import recorded_run as recorded_run
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import COLUMNS, RunTable, metrics
from trunk_experiments.commands.export import write_csv
from trunk_recording import schemas
from trunk_recording.cdr import layout_of
from trunk_recording.reader import RecordingError
from trunk_recording.schemas import event
from trunk_recording.writer import RecordingWriter
from trunk_runs.plan import make_plan, parse_swap

from .real_time import record_real_time, source_of


def table_of(path) -> RunTable:
    return RunTable.from_run(RecordedRun.open(path))


def test_columns_are_matched_by_stamp(run_file):
    table = table_of(run_file.write(6))
    k = np.arange(7.0)
    assert table.t.tolist() == [i * run_file.period_ns / 1e9 for i in range(7)]
    assert table.x.tolist() == k.tolist()
    assert table.theta.tolist() == (k + 0.25).tolist()
    assert table.x_dot.tolist() == (-k).tolist()
    assert table.theta_dot.tolist() == (-k - 0.5).tolist()
    assert table.theta_measured.tolist() == (k + 0.125).tolist()
    # The true states carry the torque of the previous step; the last is the last command.
    assert table.torque.tolist() == [0, 1, 2, 3, 4, 5, 6]
    for name in ("reference", "kp", "ki", "kd", "alpha"):
        i = law_named("pid").record_names.index(name)
        updates = [run_file.state_values(j - j % 2)[i] for j in range(7)]  # held in between
        assert getattr(table, name).tolist() == updates


def without_the_first_answers(messages):
    """Leave out what the controllers sent in the first 0.2 s."""
    answers = ("/pid/state", "/fuzzy_pid/state", "/effort_command")
    messages[:] = [m for m in messages if m[0] not in answers or m[1] >= 200_000_000]


@pytest.mark.parametrize(
    ("profile", "before"), [("step", [0.0] * 20 + [0.2] * 20), ("topic", [None] * 40)]
)
def test_in_real_time_the_first_answer_may_come_late(tmp_path, profile, before):
    """Until then the reference is what the controller's parameters say, unless it comes by topic."""
    told = (f"reference.profile={profile}", "reference.value=0.2", "reference.step_time=0.1")
    settings = tuple(f"pid.{one}" for one in told)
    plan = make_plan("demo", "pid", settings=settings, everywhere={"duration": 0.5})
    if profile == "topic":
        plan = replace(plan, references={0: 0.1})
    source, late = tmp_path / "run.mcap", tmp_path / "late.mcap"
    record_real_time(plan, source)
    copied(source, late, without_the_first_answers, ANEW)
    table = table_of(late)
    found = [None if np.isnan(one) else one for one in table.reference.tolist()]
    assert found[:40] == before
    assert np.isnan(table.kp[:40]).all()
    if profile == "step":
        assert metrics(table) == metrics(table_of(source))
    copied(source, late, without_the_first_answers, ANEW, provenance={"mode": "lockstep"})
    assert np.isnan(table_of(late).reference[:40]).all()


@pytest.mark.parametrize("why", ["unknown law", "no terms", "order of changes not known"])
def test_a_reference_before_the_first_answer_may_not_be_known(tmp_path, monkeypatch, why):
    """Of another controller than the one that was active then, the parameters say nothing."""
    plan = make_plan(
        "demo",
        "pid",
        swaps=[parse_swap("0.3:fuzzy_pid")],
        settings=("pid.reference.value=0.1", "fuzzy_pid.reference.value=-0.3"),
        everywhere={"duration": 0.5},
    )
    record_real_time(plan, tmp_path / "run.mcap")

    def edit(messages):
        without_the_first_answers(messages)
        if why == "no terms":
            messages[:] = [m for m in messages if m[0] != "/pid/state"]
        elif why == "order of changes not known":
            topic, log_time, _, *rest = next(m for m in messages if m[0] == "/run/events")
            messages.append(
                [topic, log_time, event(-1, "/pid", Event.RETUNED, source=source_of("pid")), *rest]
            )

    source, path = tmp_path / "run.mcap", tmp_path / "edited.mcap"
    copied(source, path, without_the_first_answers, ANEW)
    assert not np.isnan(table_of(path).reference).any()
    copied(source, path, edit, ANEW)
    if why == "unknown law":
        monkeypatch.setattr(recorded_run, "usable", lambda: ("fuzzy_pid",))
    assert np.isnan(table_of(path).reference[:40]).all()


def test_names_and_the_limit_come_from_the_parameters(run_file):
    parameters = {"joints": ("hüfte", "rumpf"), "max_effort": 4.5}
    path = run_file.write(6, namespace="/r", joints=("hüfte", "rumpf"), parameters=parameters)
    table = table_of(path)
    assert table.theta[3] == 3.25
    assert table.torque[-1] == 4.5


def test_joints_may_be_in_any_order(run_file):
    swapped = table_of(run_file.write(3, joints=("trunk", "hip")))
    assert swapped.theta.tolist() == [0, 1, 2, 3]  # what is at "trunk"
    renamed = table_of(run_file.write(3, joints=("a", "b")))
    assert renamed.theta.tolist() == [0.25, 1.25, 2.25, 3.25]
    with pytest.raises(RecordingError, match="no joint 'leg', only a, b"):
        table_of(run_file.write(3, joints=("a", "b"), parameters={"joints": ("a", "leg")}))


def test_without_a_last_command_the_last_torque_is_kept(run_file):
    table = table_of(run_file.write(6, drop=(topics.EFFORT_COMMAND,)))
    assert table.torque.tolist() == [0, 1, 2, 3, 4, 5, 5]


def test_what_was_not_recorded_is_nan(run_file):
    table = table_of(run_file.write(3, drop=(topics.JOINT_STATES, "pid/state")))
    for name in ("theta_measured", "reference", "kp", "ki", "kd", "alpha"):
        assert np.isnan(getattr(table, name)).all()
    with pytest.raises(RecordingError, match="no messages on /ground_truth/joint_states"):
        table_of(run_file.write(3, drop=(topics.GROUND_TRUTH,)))


def test_late_doubled_and_missing_messages(tmp_path):
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:

        def joints(topic, samples):
            channel = writer.channel(f"/{topic}", topics.JOINT_STATE_TYPE)
            for sample in samples:
                writer.write(channel, 0, 0, layout_of(sample).pack(sample))

        truth = [
            JointSample(t, ("hip", "trunk"), (0.0, t), (0.0, 0.0), (0.0, 10.0 * t))
            for t in (0, 1, 3, 2, 2, 4)
        ]
        joints(topics.GROUND_TRUTH, truth)
        seen = ((0, 0.0), (2, -2.0), (2, 99.0), (3, -3.0))
        measured = (JointSample(t, ("trunk",), (angle,)) for t, angle in seen)
        joints(topics.JOINT_STATES, measured)
        joints("pid/state", [JointSample(t, ("kp",), (50.0 + t,)) for t in (3, 1)])
        limits = writer.channel("/run/parameters", topics.PARAMETER_EVENT_TYPE)
        for new, changed in (({"max_effort": 90.0}, {}), ({}, {"max_effort": 30.0})):
            data = schemas.parameter_event(3 * len(changed), "/simulator", new, changed)
            writer.write(limits, 0, 0, data)
        joints(topics.EFFORT_COMMAND, [JointSample(4, ("trunk",), effort=(-77.0,))])
    table = table_of(path)
    nan = np.nan
    assert table.theta.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(table.theta_measured, [0, nan, -2, -3, nan])
    np.testing.assert_array_equal(table.kp, [nan, 51, 51, 53, 53])
    assert table.torque.tolist() == [10, 20, 30, 40, -30]


def test_csv_reads_back_to_the_bit(run_file, tmp_path):
    values = [0.1, -0.0, 5e-324, 1 / 3, np.nan, np.inf, -1e308]
    columns = {
        name: np.roll(np.array(values), i) for i, name in enumerate(RunTable.__dataclass_fields__)
    }
    write_csv(columns, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        head, *rows = list(csv.reader(file))
    assert ",".join(head) == (
        "t,x,theta,x_dot,theta_dot,theta_measured,reference,torque,kp,ki,kd,alpha"
    )
    assert len(rows) == len(values)
    for expected, column in zip(columns.values(), np.array(rows, float).T, strict=True):
        np.testing.assert_array_equal(column, expected)
        assert np.signbit(column).tolist() == np.signbit(expected).tolist()


def test_a_long_csv_has_a_row_per_state(tmp_path):
    count = 20_001
    ramp = np.arange(count) / 3.0
    write_csv(dict.fromkeys(COLUMNS, ramp), tmp_path / "a.csv")
    rows = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    assert rows.shape == (count, 12)
    assert (rows == ramp[:, None]).all()
