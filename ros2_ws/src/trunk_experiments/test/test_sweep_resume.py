"""What a resumed sweep accepts: blocks of the same runs by the same code, and nothing else."""

from __future__ import annotations

import json
import shutil
from importlib.util import find_spec

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from trunk_experiments.cli import trunk
from trunk_experiments.errors import StudyError, SweepError
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.study import study as design
from trunk_experiments.study import sweep as module
from trunk_experiments.study.map import panels
from trunk_experiments.study.results import Results
from trunk_experiments.study.study import Distribution, parse_study
from trunk_experiments.study.sweep import SweepJob, processes, run_block
from trunk_msgs_util import compiled
from trunk_msgs_util.parameters.declarations import values_of

PARAMETERS = """
simulator:
  ros__parameters:
    plant.length: 1.0
    hip.mode: prescribed
pid:
  ros__parameters:
    gains.p: 60.0
"""
STUDY = """
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
def study(parameters):
    return parse_study(STUDY.replace("PARAMS", str(parameters)), "study.yaml")


def interrupted(study, output):
    """Start a sweep, and stop after its first block."""
    sweep = SweepJob(study, output)
    sweep.start()
    results = processes(1)(sweep.waiting())
    sweep.keep(*next(results))
    sweep.missing.pop(0)
    return sweep


def whole(study, output):
    sweep = SweepJob(study, output)
    sweep.start()
    sweep.run(processes(1))
    sweep.finish()
    return output


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
def test_an_edited_parameter_file_is_refused(study, parameters, tmp_path, old, new, says):
    interrupted(study, tmp_path / "out.parquet")
    parameters.write_text(PARAMETERS.replace(old, new))
    with pytest.raises(StudyError, match="delete the folder, or give another -o") as caught:
        SweepJob(study, tmp_path / "out.parquet").start()
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_same_values_from_another_file_resume(study, parameters, tmp_path):
    interrupted(study, tmp_path / "out.parquet")
    parameters.write_text("# a comment\n" + PARAMETERS.replace("1.0", "1.00"))
    other = parameters.rename(tmp_path / "renamed.yaml")
    again = parse_study(STUDY.replace("PARAMS", str(other)), "moved.yaml")
    assert SweepJob(again, tmp_path / "out.parquet").start() == 3


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[1.0, 1.5, 2.0]", "[1.0, 1.5, 2.5]", "another study's: its variables differ"),
        ("block: 3", "block: 4", "another study's: its block differs"),
        ("[pid]", "{pid: {}, other: {node: pid}}", "another study's: its controllers differ"),
    ],
)
def test_another_study_is_refused(study, tmp_path, old, new, says):
    interrupted(study, tmp_path / "out.parquet")
    other = parse_study(study.text.replace(old, new), "study.yaml")
    with pytest.raises(StudyError) as caught:
        SweepJob(other, tmp_path / "out.parquet").start()
    assert says in str(caught.value)


def test_blocks_of_other_code_are_refused(study, tmp_path, monkeypatch):
    interrupted(study, tmp_path / "out.parquet")
    monkeypatch.setattr(module, "sources", lambda: "other")
    with pytest.raises(StudyError, match="other sources or libraries"):
        SweepJob(study, tmp_path / "out.parquet").start()


def test_blocks_with_other_draws_are_refused(study, tmp_path, monkeypatch):
    text = study.text.replace("values: [1.0, 1.5, 2.0]", "distribution: uniform, low: 1, high: 2")
    drawn = parse_study(text + "runs: 3\n", "study.yaml")
    interrupted(drawn, tmp_path / "out.parquet")
    design.drawn_values.cache_clear()
    monkeypatch.setattr(Distribution, "draw", lambda self, count, seed, name: [1.25] * count)
    with pytest.raises(StudyError, match="another study's: its draws differ"):
        SweepJob(drawn, tmp_path / "out.parquet").start()
    design.drawn_values.cache_clear()


DECIDE_NUMBERS = [
    "trunk_sim/config.py",
    "trunk_control/controller_config.py",
    "trunk_control/reference_config.py",
    "trunk_control/law.py",
    *(f"trunk_control/{name}.py" for name in ("pid", "fuzzy_pid", "lqr", "fuzzy_torque")),
    "trunk_msgs_util/units.py",
    "trunk_msgs_util/parameters/body.py",
    "trunk_msgs_util/parameters/declarations.py",
    "trunk_experiments/study/study.py",
    "trunk_experiments/study/sweep.py",
]


@pytest.fixture
def change(monkeypatch):
    """Let the file with a name, PACKAGE/MODULE.py, have a byte more."""

    def change(name):
        assert find_spec(name.removesuffix(".py").replace("/", "."))
        contents = compiled._contents.__wrapped__
        monkeypatch.setattr(
            compiled, "_contents", lambda path: contents(path) + b"#" * path.endswith(f"/{name}")
        )
        module.sources.cache_clear()

    yield change
    module.sources.cache_clear()


@pytest.mark.parametrize("name", DECIDE_NUMBERS)
def test_blocks_of_changed_sources_are_refused(study, tmp_path, change, name):
    interrupted(study, tmp_path / "out.parquet")
    change(name)
    with pytest.raises(StudyError, match="other sources or libraries"):
        SweepJob(study, tmp_path / "out.parquet").start()


@pytest.mark.parametrize("name", ["gateway/server.py", "views/report.py", "commands/live.py"])
def test_what_decides_no_number_does_not_discard_a_sweep(study, tmp_path, change, name):
    interrupted(study, tmp_path / "out.parquet")
    change(f"trunk_experiments/{name}")
    assert SweepJob(study, tmp_path / "out.parquet").start() == 3


def test_a_file_in_place_of_the_folder_is_refused(study, tmp_path):
    (tmp_path / "out.parquet.blocks").write_text("mine")
    with pytest.raises(StudyError, match=r"out\.parquet\.blocks: not a folder"):
        SweepJob(study, tmp_path / "out.parquet").check()


@pytest.mark.parametrize("mark", [None, "", "{}", "[1]"])
def test_undescribed_blocks_are_refused(study, tmp_path, mark):
    sweep = interrupted(study, tmp_path / "out.parquet")
    path = sweep.folder / "sweep.json"
    path.unlink()
    if mark is not None:
        path.write_text(mark)
    with pytest.raises(StudyError, match="delete the folder, or give another -o"):
        SweepJob(study, tmp_path / "out.parquet").start()


def test_a_block_from_another_folder_is_not_merged(study, parameters, tmp_path):
    sweep = interrupted(study, tmp_path / "out.parquet")
    parameters.write_text(PARAMETERS.replace("60.0", "61.0"))
    other = interrupted(study, tmp_path / "other.parquet")
    first = "00000000.parquet"
    shutil.copy(other.folder / first, sweep.folder / first)
    sweep.run(processes(1))
    with pytest.raises(SweepError, match=f"{first}: holds runs of another study"):
        sweep.finish()
    assert not sweep.output.exists()


def test_an_unreadable_block_gives_one_line(study, tmp_path):
    sweep = interrupted(study, tmp_path / "out.parquet")
    (sweep.folder / "00000000.parquet").write_bytes(b"PAR1")
    sweep.run(processes(1))
    with pytest.raises(SweepError, match=r"00000000\.parquet: cannot be read: delete it, and run"):
        sweep.finish()


def test_a_worker_with_another_study_is_refused(study, tmp_path):
    sweep = SweepJob(study, tmp_path / "out.parquet")
    sweep.start()

    def foreign(blocks):
        for block in blocks:
            yield (
                block.index,
                run_block(block).replace_schema_metadata({"sources": module.sources()}),
            )

    with pytest.raises(SweepError, match="block 0 comes from a worker with other sources"):
        sweep.run(foreign)


def test_the_file_holds_the_values_that_its_runs_used(study, parameters, tmp_path):
    path = whole(study, tmp_path / "out.parquet")
    plan = make_plan("fig6", "pid", [str(parameters)], (), {"update_rate": 200.0, "duration": 0.5})
    (told,) = json.loads(pq.read_schema(path).metadata[b"plans"])
    assert (told["controller"], told["node"], told["scenario"]) == ("pid", "pid", "fig6")
    for node, config in (("simulator", plan.simulator), ("pid", plan.controller)):
        expected = json.loads(json.dumps(values_of(config)))
        assert told["parameters"][node] == expected


@pytest.mark.slow
def test_a_map_needs_only_the_results(study, parameters, tmp_path):
    path = whole(study, tmp_path / "out.parquet")
    (before,) = panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    parameters.write_text(PARAMETERS.replace("plant.length: 1.0", "plant.length: 0.2"))
    (edited,) = panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    assert (edited.growth == before.growth).all()
    parameters.unlink()
    done = CliRunner().invoke(trunk, ["study", "map", str(path), "-o", str(tmp_path / "map.png")])
    assert done.exit_code == 0, done.exception


def test_results_without_plans_say_what_to_do(study, tmp_path):
    path = whole(study, tmp_path / "out.parquet")
    table = pq.read_table(path)
    metadata = {k: v for k, v in table.schema.metadata.items() if k != b"plans"}
    pq.write_table(table.replace_schema_metadata(metadata), path)
    with pytest.raises(StudyError, match="sweep the study again, or give --no-floquet"):
        panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    assert panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=False)
