"""The `trunk` command as a user sees it: its output and its exit codes."""

import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest

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


# As printed: overshoot, settling, steady state (mean, RMS), IAE, ISE, ITAE, effort, peak, range; -: never.
REFERENCE = {
    "fig6 pid pid_as_printed": (
        "16.222 - 15.781 15.785 2.35353 .71964 10.5043 111.81 31.435 -16.222 30"
    ),
    "fig6 pid pid_ziegler_nichols": (
        "6.6953 1.385 -1.0282 2.4776 .46310 .05308 1.88821 145.28 31.468 -6.695 30"
    ),
    "fig6 fuzzy_pid fuzzy_as_printed": (
        "9.3731 1.843 -.2794 2.7843 .63947 .07939 2.42780 126.33 31.514 -9.373 30"
    ),
    "fig7 pid pid_ziegler_nichols": (
        "9.5521 - .0071 3.4594 .60717 .08354 2.48723 51332.9 7118.2 -6.695 54.552"
    ),
    "fig7 fuzzy_pid fuzzy_as_printed": (
        "8.6754 1.066 .4719 3.1490 .66250 .09693 2.39190 204668.6 14162.4 -9.373 53.675"
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("run", REFERENCE)
def test_simulate_and_metrics_reproduce_the_reference_table(run, tmp_path):
    scenario, controller, params = run.split()
    path = tmp_path / "run.mcap"
    trunk("simulate", scenario, "--controller", controller, "--params", params, "-o", path)
    found = json.loads(trunk("metrics", path, "--json").stdout)["metrics"]
    for (key, value), printed in zip(found.items(), REFERENCE[run].split(), strict=True):
        if printed == "-":
            assert value == "Infinity", key
        else:
            half_a_digit = 0.5 * 10.0 ** -len(printed.partition(".")[2])
            assert value == pytest.approx(float(printed), rel=1e-4, abs=half_a_digit), key


@pytest.mark.slow
def test_diff_finds_where_two_runs_diverge(tmp_path):
    paths = [tmp_path / f"fig 7, {d}.mcap" for d in (9, 9.5)]  # with spaces
    for path, d in zip(paths, (9, 9.5), strict=True):
        gain = f"pid.gains.d={d}"
        trunk("simulate", "fig7", "--controller", "pid", "--set", gain, "-o", path)
    said = trunk("diff", *paths, code=1).stdout
    assert "first at t = 0 s: pid/state: position[kd]: 9 N m s/rad in A, 9.5 N m s/rad in B" in said
    assert "pid: gains.d: 9 in A, 9.5 in B" in said


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
