"""Sweeps: the same file however they run; a killed one resumes; runs equal `trunk simulate`'s."""

from __future__ import annotations

import signal
import subprocess
import sys

import pyarrow.parquet as pq
import pytest

from trunk_experiments.analysis.metrics import metrics
from trunk_experiments.analysis.run_table import RunTable
from trunk_experiments.errors import StudyError, SweepError
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.runs.offline_recording import record_offline
from trunk_experiments.study.rows import make_bases, plan_of
from trunk_experiments.study.study import design, parse_study, read_study, shipped_studies
from trunk_experiments.study.sweep import METRICS, SweepJob, processes, run_block

STUDY = """
scenario: fig8
params: profile_practical
rate: 200
duration: 3.0
controllers: [pid, fuzzy_pid]
runs: 5
block: 7
set: {simulator.substeps: 1, simulator.sensor.position_noise: 0.01}
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.01, 0.3]}
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.3, high: 0.8}
"""


@pytest.fixture(scope="module")
def study():
    return parse_study(STUDY, "study.yaml")


def make(study, path, count=1):
    sweep = SweepJob(study, path)
    sweep.start()
    sweep.run(processes(count))
    sweep.finish()
    return path.read_bytes()


@pytest.fixture(scope="module")
def undisturbed(study, tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep") / "out.parquet"
    make(study, path)
    return path


def test_the_file_does_not_depend_on_the_machine(study, undisturbed, tmp_path, monkeypatch):
    monkeypatch.setattr("platform.node", lambda: "another")
    monkeypatch.setattr("platform.platform", lambda: "Linux-1.0")
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    assert make(study, tmp_path / "there.parquet") == undisturbed.read_bytes()


def rows(path):
    return pq.read_table(path).to_pylist()


def test_rows_are_in_order_and_complete(undisturbed, study):
    found = rows(undisturbed)
    assert [row["run"] for row in found] == list(range(study.total)) == list(range(30))
    assert {row["status"] for row in found} <= {"ok", "diverged"}
    assert list(found[0])[-len(METRICS) :] == list(METRICS)


def test_draws_are_paired(undisturbed):
    drawn = {}
    for row in rows(undisturbed):
        drawn.setdefault(row["draw"], set()).add((row["seed"], row["mass"]))
    assert sorted(drawn) == list(range(5))
    assert all(len(values) == 1 for values in drawn.values())
    assert len(set.union(*drawn.values())) == 5


def test_another_draw_or_variable_changes_no_others(study):
    more = parse_study(
        STUDY.replace("runs: 5", "runs: 6")
        + "  angle: {parameter: 'simulator.initial.position[1]', "
        "distribution: normal, mean: 0.0, std: 0.1}\n",
        "study.yaml",
    )
    one, other = design(study, 0, 10), design(more, 0, 10)
    assert (one["mass"], one["seed"]) == (other["mass"], other["seed"])


def test_a_row_is_the_run_that_simulate_makes(undisturbed, tmp_path):
    row = rows(undisturbed)[11]
    plan = make_plan(
        "fig8",
        row["controller"],
        ["profile_practical"],
        [
            "simulator.sensor.position_noise=0.01",
            "simulator.substeps=1",
            f"simulator.sensor.delay={row['delay']!r}",
            f"simulator.plant.trunk_mass={row['mass']!r}",
            f"simulator.sensor.seed={row['seed']}",
        ],
        {"update_rate": 200.0, "duration": 3.0},
    )
    record_offline(plan, tmp_path / "run.mcap")
    expected = metrics(RunTable.from_run(RecordedRun.open(tmp_path / "run.mcap")))
    assert {name: row[name] for name in METRICS} == expected.as_dict()


@pytest.mark.slow
def test_processes_give_the_same_bytes(undisturbed, study, tmp_path):
    assert make(study, tmp_path / "out.parquet", 2) == undisturbed.read_bytes()


def test_provenance_and_study_are_in_the_file(undisturbed):
    told = pq.read_schema(undisturbed).metadata
    assert told[b"study"].decode() == STUDY
    assert b'"numpy"' in told[b"provenance"]
    assert told[b"grid"] == b'["delay"]'


KILLED_AFTER_FOUR_BLOCKS = """
import os, signal
from trunk_experiments.cli import main
from trunk_experiments.study.sweep import SweepJob

keep, kept = SweepJob.keep, []

def killed(self, index, table):
    keep(self, index, table)
    kept.append(index)
    if len(kept) == 4:
        os.kill(os.getpid(), signal.SIGKILL)

SweepJob.keep = killed
main()
"""


@pytest.mark.slow
def test_sigkill_loses_no_finished_block(tmp_path):
    text = STUDY.replace("duration: 3.0", "duration: 1.0").replace("[pid, fuzzy_pid]", "[pid]")
    file = tmp_path / "study.yaml"
    file.write_text(text.replace("block: 7", "block: 3"))
    output = tmp_path / "out.parquet"
    command = [sys.executable, "-c", KILLED_AFTER_FOUR_BLOCKS, "sweep"]
    command += [str(file), "-o", str(output), "--jobs", "2"]
    quiet = {"stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    assert subprocess.run(command, check=False, **quiet).returncode == -signal.SIGKILL
    folder = tmp_path / "out.parquet.blocks"
    assert not output.exists()
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("0*.parquet")}
    assert len(kept) == 4
    study = read_study(str(file))
    sweep = SweepJob(study, output)
    assert sweep.start() == 3 * len(kept)
    sweep.run(processes(1))
    assert kept.items() <= {p.name: p.stat().st_mtime_ns for p in folder.glob("0*.parquet")}.items()
    sweep.finish()
    assert output.read_bytes() == make(study, tmp_path / "undisturbed.parquet")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "out.parquet",
        "study.yaml",
        "undisturbed.parquet",
    ]


def test_blocks_of_another_study_are_refused(study, tmp_path):
    SweepJob(study, tmp_path / "out.parquet").start()
    other = parse_study(STUDY.replace("0.3]", "0.2]"), "study.yaml")
    with pytest.raises(
        StudyError, match="its finished blocks are another study's: its variables differ"
    ):
        SweepJob(other, tmp_path / "out.parquet").start()


def test_a_worker_with_other_sources_is_refused(study, tmp_path):
    sweep = SweepJob(study, tmp_path / "out.parquet")
    sweep.start()

    def foreign(blocks):
        for block in blocks:
            yield block.index, run_block(block).replace_schema_metadata({"sources": "other"})

    with pytest.raises(SweepError, match="block 0 comes from a worker with other sources"):
        sweep.run(foreign)


@pytest.mark.parametrize(
    ("parameter", "values", "reason"),
    [
        ("fuzzy_pid.gains.p_max", "20.0, 60.0", "20.0 is not allowed: at least gains.p_min"),
        ("pid.reference.profile", "topic, constant", "nobody publishes references"),
    ],
)
def test_a_row_that_cannot_be_run_is_reported(tmp_path, parameter, values, reason):
    study = STUDY.replace("pid, fuzzy_pid", parameter.partition(".")[0]).replace("runs: 5\n", "")
    vary = f"vary:\n  it: {{parameter: {parameter}, values: [{values}]}}\n"
    make(parse_study(study.partition("vary:")[0] + vary, "study.yaml"), tmp_path / "out.parquet")
    first, second = rows(tmp_path / "out.parquet")
    assert first["status"] == "refused"
    assert reason in first["reason"]
    assert (second["status"], second["reason"]) == ("ok", None)


def test_rates_vary_together():
    text = STUDY[: STUDY.index("vary:")].replace("runs: 5\n", "") + (
        "vary:\n  rate_hz: {parameter: [simulator.update_rate, controller.update_rate], "
        "values: [100, 400]}\n"
    )
    study = parse_study(text, "study.yaml")
    bases = make_bases(study)
    columns = design(study, 0, study.total)
    made = [
        plan_of(study, bases, dict(zip(columns, values, strict=True)))
        for values in zip(*columns.values(), strict=True)
    ]
    rates = [(plan.simulator.update_rate, plan.controller.update_rate) for plan in made]
    assert rates == [(100.0, 100.0)] * 2 + [(400.0, 400.0)] * 2


@pytest.mark.parametrize("name", shipped_studies())
def test_shipped_studies_are_sound(name):
    study = read_study(name)
    bases = make_bases(study)
    columns = design(study, 0, 3)
    for values in zip(*columns.values(), strict=True):
        plan_of(study, bases, dict(zip(columns, values, strict=True)))
