"""The `trunk` command as a user sees it: its output and its exit codes."""

import csv
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest

from trunk_evidence.run_metrics import Metrics
from trunk_experiments.cli import main


def trunk(*arguments, code=0, cwd=None):
    out, err = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["trunk", *map(str, arguments)])
        patch.chdir(cwd or Path.cwd())
        with pytest.raises(SystemExit) as ended:
            main()
    assert (ended.value.code or 0) == code, err.getvalue()
    return SimpleNamespace(stdout=out.getvalue(), stderr=err.getvalue())


@pytest.fixture(scope="module")
def fig7(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "fig 7.mcap"  # a space in the path
    trunk("simulate", "fig7", "--controller", "pid", "-o", path)
    return path


REFERENCE = {  # the published reference table; None: never settles
    ("fig6", "pid", "pid_as_printed"): (16.222, None, 15.781, 15.785, 2.35353, 111.81, 31.435),
    ("fig6", "pid", "pid_ziegler_nichols"): (
        6.6953,
        1.385,
        -1.0282,
        2.4776,
        0.46310,
        145.28,
        31.468,
    ),
    ("fig6", "fuzzy_pid", "fuzzy_as_printed"): (
        9.3731,
        1.843,
        -0.2794,
        2.7843,
        0.63947,
        126.33,
        31.514,
    ),
    ("fig7", "pid", "pid_ziegler_nichols"): (
        9.5521,
        None,
        0.0071,
        3.4594,
        0.60717,
        51332.9,
        7118.2,
    ),
    ("fig7", "fuzzy_pid", "fuzzy_as_printed"): (
        8.6754,
        1.066,
        0.4719,
        3.1490,
        0.66250,
        204668.6,
        14162.4,
    ),
}
KEYS = (
    "overshoot_deg",
    "settling_time_6deg_s",
    "steady_state_error_mean_deg",
    "steady_state_error_rms_deg",
    "iae",
    "effort",
    "peak_torque",
)


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("run", "expected"), REFERENCE.items(), ids=lambda v: "-".join(map(str, v))
)
def test_simulate_and_metrics_reproduce_the_reference_table(run, expected, tmp_path):
    scenario, controller, params = run
    path = tmp_path / "run.mcap"
    trunk("simulate", scenario, "--controller", controller, "--params", params, "-o", path)
    values = json.loads(trunk("metrics", path, "--json").stdout)["metrics"]
    for key, wanted in zip(KEYS, expected, strict=True):
        if wanted is None:  # it never settles
            assert values[key] == "Infinity"
        else:  # the table prints five digits
            assert values[key] == pytest.approx(wanted, rel=1e-4, abs=6e-5)


@pytest.mark.slow
def test_metrics_have_the_documented_keys(fig7):
    found = json.loads(trunk("metrics", fig7, "--json").stdout)
    assert list(found["metrics"]) == [field.name for field in fields(Metrics)]


def test_export_writes_a_row_per_state_in_full_precision(fig7, tmp_path):
    path = tmp_path / "run.csv"
    trunk("export", fig7, "-o", path)
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert ",".join(rows[0]) == (
        "t,x,theta,x_dot,theta_dot,theta_measured,reference,torque,kp,ki,kd,alpha,"
        "error,error_rate,p_term,i_term,d_term,unsaturated,command,"
        "disturbance_hip_effort,disturbance_trunk_effort,disturbance_hip_position,disturbance_trunk_position"
    )
    assert len(rows) == 1 + 10001
    assert [float(v) for v in rows[1][:5]] == [0.0, 0.0, 0.5235987755982988, 1.0, 0.0]
    assert [float(v) for v in rows[1][8:11]] == [60.0, 100.0, 9.0]
    assert all(repr(float(v)) == v for row in rows[1:50] for v in row)


def test_info_shows_the_content(fig7):
    found = json.loads(trunk("info", fig7, "--json").stdout)
    assert found["doubts"]["complete"] is True
    assert found["topics"]["/joint_states"]["messages"] == 10001
    assert found["provenance"]["scenario"] == "fig7"
    assert "/pid" in found["nodes"]
    assert "complete" in trunk("info", fig7).stdout


@pytest.mark.slow
def test_simulate_like_gives_the_same_bits(fig7, tmp_path):
    again = tmp_path / "again.mcap"
    trunk("simulate", "--like", fig7, "-o", again)
    assert trunk("diff", fig7, again).stdout.startswith("identical")
    trunk("verify", again)


@pytest.mark.slow
def test_diff_finds_where_two_runs_diverge(fig7, tmp_path):
    other = tmp_path / "other.mcap"
    trunk("simulate", "fig7", "--controller", "pid", "--set", "pid.gains.d=9.5", "-o", other)
    said = trunk("diff", fig7, other, code=1).stdout
    assert "first at t = 0 s: pid/state: position[kd]: 9 N m s/rad in A, 9.5 N m s/rad in B" in said
    assert "pid: gains.d: 9 in A, 9.5 in B" in said


MISTAKES = {
    "no such file": (("metrics", "none.mcap"), 2, "none.mcap"),
    "a directory": (("info", "."), 2, "."),
    "no scenario": (("simulate", "fig5", "-o", "x.mcap"), 2, "fig6"),
    "nothing to simulate": (("simulate", "-o", "x.mcap"), 2, "--like"),
    "no end": (("simulate", "fig6", "--duration", "0", "-o", "x.mcap"), 2, "duration"),
    "an unknown verb": (("simulat",), 2, "simulat"),
    "a folder that is not there": (("simulate", "fig6", "-o", "no/x.mcap"), 2, "no/x.mcap"),
    "an unstable loop": (
        ("simulate", "fig7", "--controller", "pid", "--params", "pid_as_printed"),
        1,
        "unstable",
    ),
}


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "code", "says"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_gives_one_line(arguments, code, says, tmp_path):
    if code == 1:
        arguments = (*arguments, "--rate", "250", "-o", "x.mcap")
    said = trunk(*arguments, code=code, cwd=tmp_path).stderr
    assert says in said
    assert sum(line.startswith("trunk: error: ") for line in said.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("metrics",), "Missing argument 'RUN' (see trunk metrics --help)"),
        (
            ("metrics", "--jsn", "x"),
            "No such option '--jsn'. Did you mean '--json'? (see trunk metrics --help)",
        ),
        (
            ("export", "x.mcap"),
            "Missing option '-o' / '--output' (see trunk export --help)",
        ),
        (
            ("list", "rnus"),
            (
                "trunk list 'rnus': give one of controllers, files, plants, runs, scenarios, schemas, "
                "studies; did you mean 'runs'?"
            ),
        ),
        (
            ("simulate", "fig8", "--rate", "x"),
            (
                "Invalid value for '--rate': 'x': it is not a number, with or without a unit; a frequency in "
                "Hz is needed, such as 5 Hz or 5 kHz (see trunk simulate --help)"
            ),
        ),
        (("--nothing",), "No such option '--nothing' (see trunk --help)"),
    ],
    ids=lambda v: " ".join(v) if isinstance(v, tuple) else "",
)
def test_wrong_usage_gives_one_line_that_says_what_to_do(arguments, says):
    done = trunk(*arguments, code=2)
    assert (done.stdout, done.stderr) == ("", f"trunk: error: {says}\n")


@pytest.mark.slow
def test_a_fall_is_said_first_of_a_simulated_run(tmp_path):
    said = trunk("simulate", "fig8", "--duration", "1.2", "-o", tmp_path / "x.mcap").stdout
    assert said.splitlines()[0] == "FELL: at t = 1.085 s, -90 degrees"


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["controller", "list", "params", "study", "tune"])
def test_help_cuts_no_sentence(verb):
    commands = trunk(verb, "--help").stdout.partition("Commands:")[2]
    assert commands.strip().endswith(".")
    assert "..." not in commands


@pytest.mark.slow
def test_a_live_run_is_either_in_lockstep_or_in_real_time():
    assert "give one of them" in trunk("live", "--realtime", "--lockstep", code=2).stderr


@pytest.mark.slow
def test_a_push_does_not_go_with_a_recorded_run(fig7, tmp_path):
    done = trunk("simulate", "--like", fig7, "--push", "1Nm:1s", "-o", tmp_path / "a.mcap", code=2)
    assert "--like has the whole run: leave out --push" in done.stderr
