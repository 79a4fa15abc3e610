"""`trunk compare`: the best of each row, what differs, where runs diverge."""

import csv
import io
import json
import re
from dataclasses import replace

import pytest
from click.testing import CliRunner

from trunk_evidence.parameter_text import differing_texts
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_metrics import QUANTITIES
from trunk_evidence.run_table import RunTable, metrics
from trunk_experiments.cli import trunk
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.timeline import Change
from trunk_views.comparison import best_of, compare, differing_parameters, split_parameters
from trunk_views.run_report import make_report, render
from trunk_views.run_view import RunView, labels


@pytest.fixture(scope="module")
def runs(short_run):
    return [short_run("fig6", "pid", duration=3.0), short_run("fig6", "fuzzy_pid", duration=3.0)]


@pytest.fixture(scope="module")
def found(runs):
    return compare([RunView.read(RecordedRun.open(run)) for run in runs])


def invoke(*arguments):
    done = CliRunner().invoke(trunk, ["compare", *map(str, arguments)])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize(
    ("values", "best"),
    [
        ((3.0, 1.0, 2.0), (1,)),
        ((-0.5, 1.0), (0,)),
        ((0.5, -0.25), (1,)),
        ((None, 7.0), (1,)),
        ((7.0, None), (0,)),
        ((None, None), ()),
        ((1.0, 1.0, 2.0), (0, 1)),
        ((0.0, -0.0), (0, 1)),
        ((1.0,), ()),
    ],
)
def test_the_smallest_magnitude_is_best_and_null_ranks_last(values, best):
    assert best_of(values) == best


@pytest.mark.slow
def test_rows_hold_the_metrics_of_each_run(runs, found):
    expected = [metrics(RunTable.from_run(RecordedRun.open(run))).as_dict() for run in runs]
    assert [row.key for row in found.rows] == list(expected[0]) == list(QUANTITIES)
    for row in found.rows:
        assert row.values == tuple(run[row.key] for run in expected)
    best = {row.key: row.best for row in found.rows}
    assert best["iae"] == (0,)  # 0.42 against 0.57
    assert best["theta_max_deg"] == ()  # an angle's range is not ranked


def test_parameters_that_differ(short_run, found):
    assert found.parameters["controller"] == ("pid", "fuzzy_pid")
    assert found.parameters["controller.gains.p"] == (60.0, None)
    assert "simulator.plant.length" not in found.parameters
    assert not any(name.startswith("recorder") for name in found.parameters)
    other = short_run("fig6", "pid", ("pid_as_printed",), duration=3.0)
    views = [
        RunView.read(RecordedRun.open(p)) for p in (short_run("fig6", "pid", duration=3.0), other)
    ]
    assert differing_parameters(views) == {
        "controller.gains.i": (100.0, 36.0),
        "controller.gains.d": (9.0, 400.0),
    }


def test_parameters_that_only_some_runs_have_are_listed_once(runs):
    parameters = {"a": (1, None, None), "b": (None, 2, 2), "c": (None, 3, 4), "d": (5, 6, 5)}
    beside, only = split_parameters("xyz", parameters)
    assert beside == {"c": (None, 3, 4), "d": (5, 6, 5)}
    assert only == {"x": {"a": 1}, "y, z": {"b": 2}}
    for form in ((), ("--markdown",)):
        text = invoke(*runs, *form)
        assert "–" not in text
        common, pid, fuzzy = re.split("nly in fig6-(?:fuzzy_)?pid", text)
        assert "controller.gains" not in common
        assert "controller.gains.p " in pid
        assert "controller.gains.p_max" in fuzzy


def test_where_runs_diverge(runs, found, short_run):
    (difference,) = found.diffs
    # At t = 0 both see the same state; the first torque already differs.
    assert (difference.first.topic, difference.first.stamp_ns) == ("effort_command", 0)
    same = compare([RunView.read(RecordedRun.open(runs[0]))] * 2)
    assert same.diffs[0].identical
    assert same.parameters == {}


def test_json(runs):
    values = json.loads(invoke(*runs, "--json"))
    assert [run["name"] for run in values["runs"]] == ["fig6-pid", "fig6-fuzzy_pid"]
    assert values["metrics"]["iae"]["best"] == ["fig6-pid"]
    assert values["first_divergence"]["fig6-fuzzy_pid"]["stamp_ns"] == 0
    assert values["parameters"]["controller"] == ["pid", "fuzzy_pid"]


def test_csv_is_exact(runs, found):
    rows = list(csv.reader(io.StringIO(invoke(*runs, "--csv"))))
    assert rows[0] == ["quantity", "unit", "fig6-pid", "fig6-fuzzy_pid", "best"]
    for row, line in zip(found.rows, rows[1:], strict=True):
        assert [float(v) if v else None for v in line[2:4]] == list(row.values)


def test_markdown_marks_the_best(runs):
    text = invoke(*runs, "--markdown")
    line = next(line for line in text.splitlines() if line.startswith("| IAE"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[-2].startswith("**")
    assert not cells[-1].startswith("**")


def test_the_table_on_a_terminal(runs):
    text = invoke(*runs)
    assert "* 0." in text
    assert "\nfirst difference\n" in text
    assert "fig6-pid (A) and fig6-fuzzy_pid (B): t = 0 s: effort_command" in text


def test_a_file_that_is_not_a_recording(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"no")
    done = CliRunner().invoke(trunk, ["compare", str(path)])
    assert done.exit_code != 0
    assert str(path) in str(done.exception)


@pytest.mark.slow
def test_a_run_without_a_level_is_not_said_to_never_settle(short_run):
    sine = ["pid.reference.profile=sine", "pid.reference.amplitude=0.5"]
    tracked = short_run("fig6", "pid", duration=3.0, settings=sine)
    swinging = short_run("fig6", "pid", duration=3.0, settings=["pid.gains.d=0.0"])
    text = invoke(tracked, swinging)
    settling = next(line for line in text.splitlines() if "settling" in line)
    assert "not defined" in settling
    assert "never" in settling
    values = json.loads(invoke(tracked, swinging, "--json"))["metrics"]["settling_time_6deg_s"]
    assert values["values"] == [None, "Infinity"]
    alone = CliRunner().invoke(trunk, ["metrics", str(tracked)]).output
    assert "never" not in alone
    report = render(make_report([RunView.read(RecordedRun.open(tracked))]))
    assert ">never</td>" not in report
    assert "not defined</td>" in report


def test_a_folder_given_as_a_dot_has_its_name(runs, tmp_path, monkeypatch):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "run.mcap").write_bytes(runs[0].read_bytes())
    monkeypatch.chdir(folder)
    for path in (".", "run.mcap", "../mine"):
        assert labels([RunView.read(RecordedRun.open(path))]) == ["mine"]
    other = tmp_path / "other" / "mine"
    other.mkdir(parents=True)
    (other / "run.mcap").write_bytes(runs[0].read_bytes())
    both = [RunView.read(RecordedRun.open(path)) for path in ("run.mcap", other / "run.mcap")]
    assert labels(both) == [f"{tmp_path.name}/mine", "other/mine"]
    assert "mine: true error" in CliRunner().invoke(trunk, ["metrics", "."]).output


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "files", "differs"),
    [
        ("fig7", (), "controller.reference.value"),
        ("fig8", (), "disturbance.pulse.start_times"),
        ("fig6", ("plant_adult_trunk",), "simulator.plant.length"),
    ],
)
def test_runs_of_different_tasks_are_not_ranked(short_run, runs, scenario, files, differs):
    paths = [runs[0], short_run(scenario, "pid", files, duration=3.0)]
    found = compare([RunView.read(RecordedRun.open(path)) for path in paths])
    assert differs in found.tasks
    assert not any(row.best for row in found.rows)
    said = invoke(*paths)
    assert said.startswith("NOT RANKED: the runs have different tasks: ")
    assert "* " not in said
    assert "**NOT RANKED" in invoke(*paths, "--markdown").splitlines()[0]
    assert differs in json.loads(invoke(*paths, "--json"))["different_tasks"]


def test_a_parameter_may_change_often_in_a_task(tmp_path):
    """Each change was once quoted in the next: sixty would have filled any memory."""
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.1})
    changes = [Change(k * 1_000_000, {"plant.length": 1.0 + k / 100}) for k in range(60)]
    paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path, count in zip(paths, (60, 59), strict=True):
        record_offline(replace(plan, changes={"simulator": changes[:count]}), path)
    tasks = compare([RunView.read(RecordedRun.open(path)) for path in paths]).tasks
    assert tasks == ("simulator.plant.length",)


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        ("disturbance.pulse.random_count=1",),
        ("disturbance.table.times=[1.0]", "disturbance.table.values=[1.0]"),
    ],
    ids=["random pulses", "a table"],
)
def test_another_disturbance_is_another_task(short_run, more):
    paths = [short_run("fig6", "pid", settings=settings) for settings in ((), more)]
    tasks = compare([RunView.read(RecordedRun.open(path)) for path in paths]).tasks
    assert more[0].partition("=")[0] in tasks
    idle = short_run("fig6", "pid", settings=("disturbance.pulse.random_seed=2",))
    assert compare([RunView.read(RecordedRun.open(p)) for p in (paths[0], idle)]).tasks == ()


@pytest.mark.slow
def test_fall_stop_makes_another_task_only_where_a_trunk_fell(short_run):
    stops = ("simulator.fall.stop=true",)
    low = ("simulator.fall.angle=0.1",)
    paths = {
        more: short_run("fig6", "pid", settings=more) for more in ((), stops, low, low + stops)
    }
    views = {more: RunView.read(RecordedRun.open(path)) for more, path in paths.items()}
    assert compare([views[()], views[stops]]).tasks == ()
    assert compare([views[low], views[low + stops]]).tasks == ("simulator.fall.stop",)


@pytest.mark.slow
def test_substeps_do_not_make_another_task(short_run, runs):
    finer = short_run("fig6", "pid", duration=3.0, settings=("simulator.substeps=20",))
    assert compare([RunView.read(RecordedRun.open(p)) for p in (runs[0], finer)]).tasks == ()


def test_a_long_array_is_shown_by_its_ends_and_what_differs_in_it():
    many = tuple(float(k) for k in range(100))
    other = (*many[:50], 50.5, *many[51:])
    first, second = differing_texts((many, other))
    assert first == "[0, 1, …, 99] (100 in all)"
    assert second == "[50] 50.0 → 50.5"
