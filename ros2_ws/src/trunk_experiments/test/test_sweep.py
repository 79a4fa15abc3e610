"""Sweeps: the same file however they run, runs equal to `trunk simulate`'s; what a resumed one accepts.

It accepts blocks of the same runs by the same code, and nothing else.
"""

import json
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec
from math import inf
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from trunk_core import PACKAGES, compiled
from trunk_core.errors import StudyError, SweepError
from trunk_core.parameters.declarations import values_of
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable, metrics
from trunk_experiments.cli import trunk
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_studies import sweep_execution as module
from trunk_studies.robustness import survival
from trunk_studies.rows import make_bases, plan_of, rows_of
from trunk_studies.stability_map import panels
from trunk_studies.study import (
    Distribution,
    Target,
    design,
    drawn_values,
    parse_study,
    read_study,
    shipped_studies,
)
from trunk_studies.sweep_execution import METRICS, SweepJob, processes, run_block
from trunk_studies.sweep_results import Results

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


FALLS = """
scenario: fig8
params: profile_practical
rate: 200
duration: 1.0
controllers: [pid, fuzzy_pid]
runs: 2
set: {simulator.substeps: 1}
vary:
  stop: {parameter: simulator.fall.stop, values: [true, false]}
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.3, high: 0.8}
"""


def test_falls_are_by_each_run_s_own_angle_as_in_its_recording_and_for_limit(tmp_path):
    angles = (0.35, 0.45, 0.55)
    entry = f"  angle: {{parameter: simulator.fall.angle, values: {list(angles)}}}\n"
    study = parse_study(FALLS + entry, "study.yaml")
    make(study, tmp_path / "out.parquet")
    bases, columns = make_bases(study), design(study, 0, study.total)
    found = rows(tmp_path / "out.parquet")
    for row, drawn in zip(found, rows_of(columns), strict=True):
        record_offline(plan_of(study, bases, drawn), tmp_path / "run.mcap", overwrite=True)
        recorded = RecordedRun.open(tmp_path / "run.mcap")
        assert row["fell"] == (recorded.fall is not None), row
    fallen = Results.read(tmp_path / "out.parquet").fallen
    assert fallen.tolist() == [float(row["fell"]) for row in found]
    assert 0 < fallen.sum() < len(found)
    target = Target("simulator", "fall.angle")
    for name, curve in survival(parse_study(FALLS, "study.yaml"), target, angles).items():
        for point in curve.points:
            of_point = [
                row["fell"]
                for row in found
                if (row["controller"], row["angle"]) == (name, point.value)
            ]
            assert point.share == 1.0 - sum(of_point) / len(of_point)


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
    numbers = {name: None if value == inf else value for name, value in expected.as_dict().items()}
    assert {name: row[name] for name in METRICS} == numbers


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
from trunk_studies.sweep_execution import SweepJob

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


@pytest.mark.parametrize("foreign_sources", [True, False], ids=["sources", "study"])
def test_a_worker_with_other_sources_or_another_study_is_refused(study, tmp_path, foreign_sources):
    sweep = SweepJob(study, tmp_path / "out.parquet")
    sweep.start()
    metadata = {"sources": "other"} if foreign_sources else {"sources": module.sources()}

    def foreign(blocks):
        for block in blocks:
            yield block.index, run_block(block).replace_schema_metadata(metadata)

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
    made = [plan_of(study, bases, row) for row in rows_of(design(study, 0, study.total))]
    rates = [(plan.simulator.update_rate, plan.controller.update_rate) for plan in made]
    assert rates == [(100.0, 100.0)] * 2 + [(400.0, 400.0)] * 2


@pytest.mark.parametrize("name", shipped_studies())
def test_shipped_studies_are_sound(name):
    study = read_study(name)
    bases = make_bases(study)
    for row in rows_of(design(study, 0, 3)):
        plan_of(study, bases, row)


PARAMETERS = """
simulator:
  ros__parameters:
    plant.length: 1.0
    hip.mode: prescribed
pid:
  ros__parameters:
    gains.p: 60.0
"""
OWN_STUDY = """
scenario: fig6
params: PARAMS
rate: 200
duration: 0.5
controllers: [pid]
block: 3
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.01, 0.02]}
  gain: {parameter: pid.gains.p, as: factor, values: [1.0, 1.5, 2.0]}
"""


@pytest.fixture
def parameters(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(PARAMETERS)
    return path


@pytest.fixture
def own_study(parameters):
    return parse_study(OWN_STUDY.replace("PARAMS", str(parameters)), "study.yaml")


def interrupted(own_study, output):
    """Start a sweep, and stop after its first block."""
    sweep = SweepJob(own_study, output)
    sweep.start()
    results = processes(1)(sweep.waiting())
    sweep.keep(*next(results))
    sweep.missing.pop(0)
    return sweep


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "plant.length: 1.0",
            "plant.length: 1.5",
            "pid: simulator.plant.length was 1.0, is now 1.5",
        ),
        ("gains.p: 60.0", "gains.p: 61.0", "pid: pid.gains.p was 60.0, is now 61.0"),
    ],
)
def test_an_edited_parameter_file_is_refused(own_study, parameters, tmp_path, old, new, says):
    interrupted(own_study, tmp_path / "out.parquet")
    parameters.write_text(PARAMETERS.replace(old, new))
    with pytest.raises(StudyError, match="delete the folder, or give another -o") as caught:
        SweepJob(own_study, tmp_path / "out.parquet").start()
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_same_values_from_another_file_resume(own_study, parameters, tmp_path):
    interrupted(own_study, tmp_path / "out.parquet")
    parameters.write_text("# a comment\n" + PARAMETERS.replace("1.0", "1.00"))
    other = parameters.rename(tmp_path / "renamed.yaml")
    again = parse_study(OWN_STUDY.replace("PARAMS", str(other)), "moved.yaml")
    assert SweepJob(again, tmp_path / "out.parquet").start() == 3


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[1.0, 1.5, 2.0]", "[1.0, 1.5, 2.5]", "another study's: its variables differ"),
        ("block: 3", "block: 4", "another study's: its block differs"),
        ("[pid]", "{pid: {}, other: {node: pid}}", "another study's: its controllers differ"),
    ],
)
def test_another_study_is_refused(own_study, tmp_path, old, new, says):
    interrupted(own_study, tmp_path / "out.parquet")
    other = parse_study(own_study.text.replace(old, new), "study.yaml")
    with pytest.raises(StudyError) as caught:
        SweepJob(other, tmp_path / "out.parquet").start()
    assert says in str(caught.value)


def test_blocks_of_other_code_are_refused(own_study, tmp_path, monkeypatch):
    interrupted(own_study, tmp_path / "out.parquet")
    monkeypatch.setattr(module, "sources", lambda: "other")
    with pytest.raises(StudyError, match="other sources or libraries"):
        SweepJob(own_study, tmp_path / "out.parquet").start()


def test_blocks_with_other_draws_are_refused(own_study, tmp_path, monkeypatch):
    text = own_study.text.replace(
        "values: [1.0, 1.5, 2.0]", "distribution: uniform, low: 1, high: 2"
    )
    drawn = parse_study(text + "runs: 3\n", "study.yaml")
    interrupted(drawn, tmp_path / "out.parquet")
    drawn_values.cache_clear()
    monkeypatch.setattr(Distribution, "draw", lambda self, count, seed, name: [1.25] * count)
    with pytest.raises(StudyError, match="another study's: its draws differ"):
        SweepJob(drawn, tmp_path / "out.parquet").start()
    drawn_values.cache_clear()


DECIDE_NUMBERS = [
    "trunk_sim/config.py",
    "trunk_control/reference.py",
    "trunk_control/law.py",
    *(f"trunk_control/{name}.py" for name in ("pid", "fuzzy_pid", "lqr", "fuzzy_torque")),
    "trunk_core/units.py",
    "trunk_core/parameters/shared.py",
    "trunk_core/parameters/declarations.py",
    "trunk_recording/joint_table.py",
    "trunk_msgs_util/source.py",
    "trunk_runs/loop.py",
    "trunk_evidence/run_metrics.py",
    "trunk_studies/study.py",
    "trunk_studies/sweep_execution.py",
]


@pytest.fixture
def change(monkeypatch):
    """Let the file with a name, PACKAGE/MODULE.py, have a word more."""

    def change(name):
        assert find_spec(name.removesuffix(".py").replace("/", "."))
        meaning = compiled._meaning
        monkeypatch.setattr(
            compiled, "_meaning", lambda path: meaning(path) + b"#" * path.endswith(f"/{name}")
        )
        module.sources.cache_clear()

    yield change
    module.sources.cache_clear()


@pytest.mark.parametrize("name", DECIDE_NUMBERS)
def test_blocks_of_changed_sources_are_refused(own_study, tmp_path, change, name):
    interrupted(own_study, tmp_path / "out.parquet")
    change(name)
    with pytest.raises(StudyError, match="other sources or libraries"):
        SweepJob(own_study, tmp_path / "out.parquet").start()


DECIDE_NONE = [
    *("trunk_views/live/server.py", "trunk_views/run_report.py"),
    "trunk_experiments/commands/live.py",
]


def test_each_package_decides_numbers_or_none():
    decide, none = ({name.partition("/")[0] for name in x} for x in (DECIDE_NUMBERS, DECIDE_NONE))
    assert decide | none == {*PACKAGES}
    assert not decide & none


@pytest.mark.parametrize("name", DECIDE_NONE)
def test_what_decides_no_number_does_not_discard_a_sweep(own_study, tmp_path, change, name):
    interrupted(own_study, tmp_path / "out.parquet")
    change(name)
    assert SweepJob(own_study, tmp_path / "out.parquet").start() == 3


def test_what_is_no_file_is_refused_before_any_run(own_study):
    with pytest.raises(StudyError, match=r"/dev/null: not a regular file: name a new \.parquet"):
        SweepJob(own_study, Path("/dev/null")).check()


def test_a_block_under_another_s_name_is_not_merged(own_study, tmp_path):
    sweep = interrupted(own_study, tmp_path / "out.parquet")
    sweep.run(processes(1))
    shutil.copy(sweep.folder / "00000000.parquet", sweep.folder / "00000001.parquet")
    with pytest.raises(
        SweepError, match=r"00000001\.parquet: holds runs of another study, another b"
    ):
        sweep.finish()


def test_a_file_in_place_of_the_folder_is_refused(own_study, tmp_path):
    (tmp_path / "out.parquet.blocks").write_text("mine")
    with pytest.raises(StudyError, match=r"out\.parquet\.blocks: not a folder"):
        SweepJob(own_study, tmp_path / "out.parquet").check()


@pytest.mark.parametrize("mark", [None, "", "{}", "[1]"])
def test_undescribed_blocks_are_refused(own_study, tmp_path, mark):
    sweep = interrupted(own_study, tmp_path / "out.parquet")
    path = sweep.folder / "sweep.json"
    path.unlink()
    if mark is not None:
        path.write_text(mark)
    with pytest.raises(StudyError, match="delete the folder, or give another -o"):
        SweepJob(own_study, tmp_path / "out.parquet").start()


def test_a_block_from_another_folder_is_not_merged(own_study, parameters, tmp_path):
    sweep = interrupted(own_study, tmp_path / "out.parquet")
    parameters.write_text(PARAMETERS.replace("60.0", "61.0"))
    other = interrupted(own_study, tmp_path / "other.parquet")
    first = "00000000.parquet"
    shutil.copy(other.folder / first, sweep.folder / first)
    sweep.run(processes(1))
    with pytest.raises(SweepError, match=f"{first}: holds runs of another study"):
        sweep.finish()
    assert not sweep.output.exists()


def test_an_unreadable_block_gives_one_line(own_study, tmp_path):
    sweep = interrupted(own_study, tmp_path / "out.parquet")
    (sweep.folder / "00000000.parquet").write_bytes(b"PAR1")
    sweep.run(processes(1))
    with pytest.raises(SweepError, match=r"00000000\.parquet: cannot be read: delete it, and run"):
        sweep.finish()


def test_the_file_holds_the_values_that_its_runs_used(own_study, parameters, tmp_path):
    path = tmp_path / "out.parquet"
    make(own_study, path)
    plan = make_plan("fig6", "pid", [str(parameters)], (), {"update_rate": 200.0, "duration": 0.5})
    (told,) = json.loads(pq.read_schema(path).metadata[b"plans"])
    assert (told["controller"], told["node"], told["scenario"]) == ("pid", "pid", "fig6")
    for node, config in (("simulator", plan.simulator), ("pid", plan.controller)):
        expected = json.loads(json.dumps(values_of(config)))
        assert told["parameters"][node] == expected


@pytest.mark.slow
def test_a_map_needs_only_the_results(own_study, parameters, tmp_path):
    path = tmp_path / "out.parquet"
    make(own_study, path)
    (before,) = panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    parameters.write_text(PARAMETERS.replace("plant.length: 1.0", "plant.length: 0.2"))
    (edited,) = panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    assert (edited.growth == before.growth).all()
    parameters.unlink()
    done = CliRunner().invoke(trunk, ["study", "map", str(path), "-o", str(tmp_path / "map.png")])
    assert done.exit_code == 0, done.exception


def test_results_without_plans_say_what_to_do(own_study, tmp_path):
    path = tmp_path / "out.parquet"
    make(own_study, path)
    table = pq.read_table(path)
    metadata = {k: v for k, v in table.schema.metadata.items() if k != b"plans"}
    pq.write_table(table.replace_schema_metadata(metadata), path)
    with pytest.raises(StudyError, match="sweep the study again, or give --no-floquet"):
        panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    assert panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=False)
