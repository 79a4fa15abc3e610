"""``trunk sweep --check`` refuses what ``trunk sweep`` refuses, with the same message, before any run."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from trunk_experiments.cli import trunk
from trunk_experiments.errors import StudyError
from trunk_experiments.study.rows import make_bases
from trunk_experiments.study.study import parse_study

HEAD = "scenario: fig6\nrate: 200\nduration: 0.5\ncontrollers: [pid]\n"
DELAY = "vary:\n  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.01]}\n"


def told(*arguments):
    """Return the exit code and the line that `trunk` ends with."""
    done = CliRunner().invoke(trunk, [str(argument) for argument in arguments])
    if done.exit_code == 0:
        return 0, done.output
    return done.exit_code, str(done.exception) if done.exit_code == 1 else done.output


REFUSED = {
    "references from nobody": (
        HEAD + "set: {pid.reference.profile: topic}\n" + DELAY,
        "pid: pid: reference.profile is 'topic', but nobody publishes references",
    ),
    "nobody's turn": (
        HEAD + "set: {pid.active.times: [0.1]}\n" + DELAY,
        "pid: active.times: no controller would act at t = 0 s",
    ),
    "a run without an end": (
        HEAD + "vary:\n  t: {parameter: simulator.duration, values: [0.5, 0.0]}\n",
        "vary.t: simulator.duration: duration is 0 s: a compiled run needs an end",
    ),
    "a run that fits no memory": (
        HEAD.replace("duration: 0.5", "duration: 1.0e+6") + DELAY,
        "pid: 200000001 states in a run: at most 20000000 are allowed",
    ),
    "a drawn run that fits no memory": (
        HEAD + "vary:\n  t: {parameter: simulator.duration, as: factor, values: [1.0, 1.0e+6]}\n",
        "vary.t: simulator.duration: 100000001 states in a run: at most",
    ),
    "a pointless repetition": (
        HEAD + "runs: 3\n" + DELAY,
        "runs: is 3, but nothing is drawn and there is no noise: leave it out",
    ),
}


@pytest.mark.parametrize(("text", "line"), REFUSED.values(), ids=REFUSED)
def test_check_and_sweep_give_the_same_error(tmp_path, text, line):
    study, output = tmp_path / "study.yaml", tmp_path / "out.parquet"
    study.write_text(text)
    checked = told("sweep", study, "-o", output, "--check")
    assert line in checked[1]
    assert checked[0] != 0
    assert told("sweep", study, "-o", output, "--jobs", 1) == checked
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


def test_check_notices_the_blocks_of_another_study(tmp_path):
    study, output = tmp_path / "study.yaml", tmp_path / "out.parquet"
    study.write_text(HEAD + DELAY)
    (tmp_path / "out.parquet.blocks").mkdir()
    (tmp_path / "out.parquet.blocks" / "sweep.json").write_text("{}")
    checked = told("sweep", study, "-o", output, "--check")
    assert "delete the folder, or give another -o" in checked[1]
    assert told("sweep", study, "-o", output, "--jobs", 1) == checked


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("none/out.parquet", "there is no folder"),
        ("out.csv", "the file's name must end in .parquet"),
        ("there.parquet", "exists: give another name, or --force"),
        ("study.yaml/out.parquet", "is not a folder"),
    ],
)
def test_an_impossible_output_is_refused_first(tmp_path, name, line):
    study = tmp_path / "study.yaml"
    study.write_text(HEAD + DELAY)
    (tmp_path / "there.parquet").write_text("mine")
    checked = told("sweep", study, "-o", tmp_path / name, "--check")
    assert line in checked[1]
    assert told("sweep", study, "-o", tmp_path / name) == checked
    assert (tmp_path / "there.parquet").read_text() == "mine"


def test_check_writes_nothing(tmp_path):
    study = tmp_path / "study.yaml"
    study.write_text(HEAD + DELAY)
    code, line = told("sweep", study, "-o", tmp_path / "out.parquet", "--check")
    assert (code, "2 runs in 1 blocks" in line) == (0, True)
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


NOISE = "simulator:\n  ros__parameters:\n    sensor.position_noise: 0.01\n"


def test_noise_in_a_parameter_file_makes_runs_differ(tmp_path):
    (tmp_path / "mine.yaml").write_text(NOISE)
    text = HEAD + f"runs: 3\nparams: {tmp_path / 'mine.yaml'}\n" + DELAY
    assert make_bases(parse_study(text, "study.yaml"))


@pytest.mark.parametrize(
    "vary",
    [
        "vary:\n  v: {parameter: simulator.sensor.velocity_noise, values: [0.0, 0.1]}\n",
        "vary:\n  v: {parameter: disturbance.noise.rms, as: offset, values: [0.1]}\n",
    ],
)
def test_noise_that_varies_makes_runs_differ(vary):
    assert make_bases(parse_study(HEAD + "runs: 3\n" + vary, "study.yaml"))


@pytest.mark.parametrize(
    "text",
    [
        "# no noise here\n" + HEAD + "runs: 3\n" + DELAY,
        HEAD + "seed: 5\nruns: 3\n" + DELAY,
        HEAD + "runs: 3\nset: {simulator.sensor.position_noise: 0.0}\n" + DELAY,
        HEAD + "runs: 3\nvary:\n  s: {parameter: simulator.sensor.seed, values: [1, 2]}\n",
        HEAD
        + "runs: 3\nvary:\n  n: {parameter: disturbance.noise.rms, as: factor, values: [1.0, 2.0]}\n",
    ],
)
def test_repeats_without_noise_are_refused(text):
    with pytest.raises(StudyError, match="runs: is 3, but nothing is drawn and there is no noise"):
        make_bases(parse_study(text, "study.yaml"))
