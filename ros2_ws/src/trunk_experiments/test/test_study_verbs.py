"""`trunk study`: one of a sweep's runs again, bit by bit; what cannot be shown is refused by name."""

from __future__ import annotations

import pyarrow.parquet as pq
import pytest

from trunk_experiments.analysis.recorded_metrics import recorded_metrics
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.verify import verify
from trunk_experiments.study.file import parse_study
from trunk_experiments.study.results import METRICS
from trunk_experiments.study.sweep import Sweep, processes

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
    sweep = Sweep(parse_study(STUDY, "study.yaml"), tmp_path_factory.mktemp("s") / "out.parquet")
    sweep.start()
    sweep.run(processes(1))
    sweep.finish()
    return sweep.output


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
    assert f"run {run}, pid, 251 states; delay 0, mass 0.4, angle 0." in out
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


def test_a_run_that_is_not_there_is_named(swept, tmp_path, command_says):
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
