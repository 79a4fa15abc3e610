"""The examples run, and say in one line what is wrong."""

import sys
from math import pi
from pathlib import Path

import pytest

from trunk_core.mechanics import path_height
from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_runs.plan import make_plan

from .finished import finished

EXAMPLES = Path(__file__).parents[1] / "examples"
SHORT = """/**:
  ros__parameters: {update_rate: 200.0, substeps: 1, duration: 0.5}
"""


@pytest.fixture
def train(tmp_path):
    (tmp_path / "short.yaml").write_text(SHORT)

    def run(*words, script="train_linear_policy.py"):
        command = [sys.executable, EXAMPLES / script, "--scenario", "short.yaml", *words]
        return finished(command, cwd=tmp_path)

    return run


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_a_policy_is_trained_saved_and_compared(train, tmp_path):
    done = train("-o", "out", "--generations", "6", "--population", "16")
    assert done.returncode == 0, done.stderr
    medians = [float(line.split()[-1]) for line in done.stdout.splitlines() if "median" in line]
    assert len(medians) == 6
    assert medians[-1] > medians[0]
    assert "policy.mcap: verified" in done.stdout
    assert verify(Recording.open(tmp_path / "out" / "policy.mcap")).exit_code == VERIFIED
    assert "ISE" in done.stdout
    assert "metrics (* best)" in done.stdout, "the same task"
    assert (tmp_path / "out" / "report.html").stat().st_size > 100_000
    again = train("-o", "out")
    assert again.returncode == 2
    assert again.stderr.splitlines()[-1].endswith(
        "--output out: it exists: name a folder that does not"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--scenario", "fig5"], "no scenario 'fig5': give one of"),
        (["--population", "1"], "--population 2 or more"),
    ],
)
def test_a_wrong_argument_gives_one_line_and_leaves_nothing(train, tmp_path, words, says):
    done = train("-o", "out", *words)
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_network_is_trained_for_some_steps_and_judged(train, tmp_path):
    pytest.importorskip("stable_baselines3")
    words = "--steps", "20", "--episodes", "2"
    done = train("-o", "out", *words, script="train_sac.py")
    assert done.returncode == 0, done.stderr
    assert "20 steps" in done.stdout
    fell = [line.split()[:4] for line in done.stdout.splitlines() if " of 2 " in line]
    assert [line[0] for line in fell] == ["policy", "fuzzy_pid", "lqr"]
    assert fell[1][1:] == fell[2][1:] == ["0", "of", "2"]
    assert "policy.mcap: verified" in done.stdout
    again = train("-o", "on", "--policy", "out/policy.zip", *words, script="train_sac.py")
    assert [line for line in again.stdout.splitlines() if " of 2 " in line] == [
        line for line in done.stdout.splitlines() if " of 2 " in line
    ]


@pytest.mark.slow
def test_a_path_is_fitted_to_measured_points(tmp_path):
    k, harmonics = 2.0 * pi / 0.7, (0.001, -0.003, 0.0, 0.002, -0.001, 0.004)
    points = [(x / 100, 0.9 + path_height(x / 100, 0.0, k, harmonics)) for x in range(71)]
    (tmp_path / "gait.csv").write_text("x,y\n" + "".join(f"{x!r},{y!r}\n" for x, y in points))
    command = [sys.executable, EXAMPLES / "fit_hip_path.py", "gait.csv", "walk.yaml", "--harmonics"]
    done = finished([*command, "3"], cwd=tmp_path)
    assert done.stdout.startswith("71 points: "), done.stderr
    plan = make_plan("fig6", "computed_torque", ["profile_walking", str(tmp_path / "walk.yaml")])
    fitted = plan.simulator.constants
    assert (fitted.amplitude, fitted.wavenumber) == (0.0, pytest.approx(k))
    assert fitted.harmonics == pytest.approx(harmonics, abs=1e-12)
    assert fitted == plan.controller.model
    for words, says in ((["3"], "File exists"), (["40"], "the points determine")):
        again = finished([*command, *words], cwd=tmp_path)
        assert again.returncode == 2
        assert says in again.stderr.splitlines()[-1]
