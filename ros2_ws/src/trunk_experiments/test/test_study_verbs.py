"""`trunk study`: the report, and a run repeated bit by bit; what cannot be shown is refused by name.

`trunk diff` of two sweeps: what differs is counted and named; what cannot be compared is refused.
"""

import html
import json
import math
import re
import shlex
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trunk_evidence.judgement import verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import recorded_metrics
from trunk_studies.statistics import distributions, falls, worst_runs
from trunk_studies.study import parse_study
from trunk_studies.study_report import make_report, render
from trunk_studies.sweep_execution import SweepJob, processes
from trunk_studies.sweep_results import METRICS, Results

from ...trunk_views.test.page_driver import NARROW, PHONE

STUDY = """
scenario: fig6
rate: 100
duration: 2.5
controllers:
  pid: {params: profile_practical}
  wild: {node: pid, set: {pid.gains.d: 1.0e6}}
runs: 6
set: {simulator.substeps: 1, simulator.sensor.position_noise: 0.001}
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.3]}
  mass: {parameter: simulator.plant.trunk_mass, values: [0.4, 0.5, 0.6]}
  angle: {parameter: "simulator.initial.position[1]", distribution: uniform, low: 0.1, high: 0.4}
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    sweep = SweepJob(parse_study(STUDY, "study.yaml"), tmp_path_factory.mktemp("s") / "out.parquet")
    sweep.start()
    sweep.run(processes(1))
    sweep.finish()
    return sweep.output


def test_the_smallest_angle_keeps_its_sign(swept):
    results = Results.read(swept)
    (found, _) = distributions(results)["theta_min_deg"]
    stood = results.of(found.controller).only(results.of(found.controller).fallen == 0.0)
    assert found.histogram.edges[0] == min(stood.column("theta_min_deg")) < 0.0


def rows(path):
    return pq.read_table(path).to_pylist()


def first(path, condition):
    return next(row["run"] for row in rows(path) if condition(row))


def changed(path, target, name, run, value):
    """Write the results with one value changed."""
    table = pq.read_table(path)
    at = table.column_names.index(name)
    values = table[name].to_pylist()
    values[run] = value
    pq.write_table(table.set_column(at, table.schema.field(at), [values]), target)
    return target


def test_a_run_shown_again_verifies_and_has_the_bits_of_its_row(swept, tmp_path, command_says):
    run = first(swept, lambda row: row["draw"] == 2 and row["status"] == "ok")
    target = tmp_path / "run.mcap"
    code, out, err = command_says("study", "show", swept, "--run", run, "-o", target)
    assert (code, err) == (0, "")
    assert f"run {run}, pid, 251 states; delay 0 s, mass 0.4 kg, angle " in out
    found = RecordedRun.open(target)
    assert verify(found.recording).word == "verified"
    row = rows(swept)[run]
    assert recorded_metrics(found).as_dict() == {name: row[name] for name in METRICS}


def test_a_fall_and_a_divergence_are_said_first(swept, tmp_path, command_says):
    fell = first(swept, lambda row: row["status"] == "ok" and row["theta_max_deg"] > 90.0)
    _, out, _ = command_says("study", "show", swept, "--run", fell, "-o", tmp_path / "a.mcap")
    assert out.startswith("fell, as in the sweep\n")
    wild = first(swept, lambda row: row["status"] == "diverged")
    code, out, _ = command_says("study", "show", swept, "--run", wild, "-o", tmp_path / "b.mcap")
    assert code == 0
    assert out.startswith("diverged, as in the sweep: ")
    assert "bits" not in out


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("iae", 1.0, "run again it gives iae 0."),
        ("status", "diverged", "status 'ok', not 'diverged'"),
        ("angle", 0.2, "the study in the file does not give its angle 0.2, not 0."),
        ("status", "refused", "run 0 was refused"),
    ],
)
def test_a_row_that_is_not_the_run_is_refused(swept, tmp_path, command_says, name, value, line):
    file = changed(swept, tmp_path / "changed.parquet", name, 0, value)
    target = tmp_path / "run.mcap"
    code, out, err = command_says("study", "show", file, "--run", 0, "-o", target)
    assert (code, out) == (2, "")
    assert err.startswith(f"trunk: error: {file}: run 0")
    assert line in err
    assert err.count("\n") == 1
    assert not target.exists()


def test_a_missing_run_is_named(swept, tmp_path, command_says):
    code, _, err = command_says("study", "show", swept, "--run", 4711, "-o", tmp_path / "x.mcap")
    assert code == 2
    assert err == f"trunk: error: {swept}: no run 4711: they are numbered 0 to 71\n"


def test_other_sources_are_named_as_the_reason(swept, tmp_path, command_says):
    file = changed(swept, tmp_path / "changed.parquet", "iae", 0, 1.0)
    table = pq.read_table(file)
    told = {**table.schema.metadata, b"sources": b"others"}
    pq.write_table(table.replace_schema_metadata(told), file)
    _, _, err = command_says("study", "show", file, "--run", 0, "-o", tmp_path / "x.mcap")
    assert "it was swept by other code, libraries or arithmetic" in err


@pytest.fixture(scope="module")
def page(swept):
    file = swept.with_name("o <b> t.parquet")
    shutil.copy(swept, file)
    return render(make_report(Results.read(file), "iae"))


def test_the_report_begins_with_falls_and_has_its_parts_in_order(swept, page):
    results = Results.read(swept)
    pid, wild = falls(results)
    assert 0 < pid.fell < pid.runs == 36
    assert wild.fell == 36
    parts = (
        f"pid fell in {pid.fell} of 36 runs; 95 %: {pid.bounds}",
        "wild fell in 36 of 36 runs; 95 %: at least 90 %",
        "How often each fell",
        "Map: IAE",
        "overshoot, °",
        "36 of 36 pairs left out",
        "The worst 10 runs",
        "The study's file",
    )
    places = [page.index(part) for part in parts]
    assert places == sorted(places)
    assert page.count("data:image/png;base64,") == 2 + len(METRICS)  # maps, scatters
    assert "<b>" not in page
    assert "http" not in page.replace("http-equiv", "")


def test_the_worst_runs_are_those_that_fell_and_their_commands_work(
    swept, page, tmp_path, command_says, monkeypatch
):
    commands = [shlex.split(html.unescape(one)) for one in re.findall(r"<code>(.*?)</code>", page)]
    shows = [one for one in commands if one[:3] == ["trunk", "study", "show"] and len(one) > 3]
    assert len(shows) == 10
    monkeypatch.chdir(tmp_path)
    command = [str(swept) if word.endswith(".parquet") else word for word in shows[0][1:]]
    code, out, _ = command_says(*command)
    assert code == 0
    assert out.startswith("diverged, as in the sweep")
    lacks = first(swept, lambda row: row["status"] == "ok" and row["delay"] == 0.0)
    file = changed(swept, tmp_path / "lacks.parquet", "iae", lacks, None)
    every = worst_runs(Results.read(file), "iae", 72)
    ended = [one.ended.split()[0].strip(",") for one in every]
    assert list(dict.fromkeys(ended)) == ["diverged", "fell", "stood"]
    assert len(every) == 72
    assert {type(one.fell) for one in every} == {bool}
    standing = [one.value for one in every if not one.fell]
    assert standing[0] is None  # it may be worse than any
    assert standing[1:] == sorted(standing[1:], reverse=True)
    assert len(standing) > 10


def test_the_verb_writes_the_report(swept, tmp_path, command_says):
    target = tmp_path / "page.html"
    words = ("study", "report", swept, "-o", target, "--no-floquet", "--metric")
    assert command_says(*words, "nix")[2].startswith("trunk: error: no metric 'nix': one of")
    code, out, _ = command_says(*words, "effort")
    assert code == 0
    assert out.startswith(f"{target}: 72 runs, ")
    assert "Map: effort" in target.read_text(encoding="utf-8")
    assert "it exists" in command_says(*words, "effort")[2]


@pytest.mark.browser
def test_the_page_asks_for_nothing_and_fits_a_phone(opened, page, tmp_path):
    file = tmp_path / "page.html"
    file.write_text(page, encoding="utf-8")
    view = opened(file, PHONE, "img")
    assert view.evaluate(NARROW)
    heights = view.eval_on_selector_all("img", "all => all.map((one) => one.naturalHeight)")
    assert all(heights)
    view.emulate_media(color_scheme="dark")
    filters = view.eval_on_selector_all("img", "all => all.map((e) => getComputedStyle(e).filter)")
    assert "none" not in filters, "no picture is white in the dark"


def write(path, numbers=(0, 1, 2), iae=(0.1, 0.2, None), commit="a", study="s", **more):
    """Write what looks like a sweep's results."""
    columns = {
        "run": pa.array(numbers, pa.int64()),
        "controller": ["pid"] * len(numbers),
        "status": ["ok"] * len(numbers),
        "iae": pa.array(iae, pa.float64()),
    }
    metadata = {"study": study, "grid": "[]", "provenance": json.dumps({"commit": commit})}
    table = pa.table({**columns, **more}).replace_schema_metadata(metadata)
    pq.write_table(table, path)
    return str(path)


@pytest.fixture
def diff(tmp_path, command_says):
    """Compare the plain results with others; return the exit code and the lines."""

    def run(**others):
        paths = write(tmp_path / "a.parquet"), write(tmp_path / "b", **others)
        code, out, err = command_says("diff", *paths)
        return code, (out + err).splitlines()

    return run


def test_equal_runs_are_identical_in_any_order(diff):
    assert diff() == (0, ["identical: 3 runs, bit for bit"])
    code, lines = diff(numbers=(2, 1, 0), iae=(None, 0.2, 0.1), commit="b", study="t")
    assert code == 0
    assert lines == [
        "identical: 3 runs, bit for bit",
        "  study: not the same",
        "  provenance: commit: a in A, b in B",
    ]


def test_the_first_cell_and_the_largest_distance_are_named(diff):
    near = math.nextafter(0.2, 1.0), math.nextafter(0.1, 1.0)
    far = math.nextafter(near[1], 1.0)
    assert diff(iae=(far, near[0], None)) == (
        1,
        [f"different in 2 runs; first in run 0, iae: 0.1 in A, {far!r} in B; at most 2 ULP apart"],
    )
    assert diff(iae=(0.1, 0.2, 0.3))[1] == [
        "different in 1 runs; first in run 2, iae: nothing in A, 0.3 in B"
    ]
    assert diff(iae=(0.1, 0.2, math.nan))[0] == 1


def test_runs_and_columns_of_one_alone_differ(diff):
    assert diff(numbers=(0, 1, 3))[1] == [
        "different in 2 runs; first in run 2, run: 2 in A, nothing in B"
    ]
    assert diff(mass=[1.0, 1.0, 1.0])[1] == [
        "different in 3 runs; first in run 0, mass: nothing in A, 1.0 in B"
    ]


def test_what_cannot_be_compared_is_refused_in_one_line(diff, command_says, tmp_path):
    code, [line] = diff(numbers=(0, 1, 1))
    assert code == 2
    assert line.endswith("b: a number of a run appears twice: sweep the study again")
    other = tmp_path / "run.mcap"
    other.write_bytes(b"\x89MCAP0\r\n")
    code, _, err = command_says("diff", tmp_path / "a.parquet", other)
    assert code == 2
    assert err.endswith("run.mcap: not a Parquet file: give the results of a trunk sweep\n")
