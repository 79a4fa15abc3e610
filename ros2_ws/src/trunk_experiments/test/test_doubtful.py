"""What a user most likely did not mean is refused, or gets a warning that names it."""

import re
import sys
from pathlib import Path

import pytest

from trunk_core.errors import PlanError, closest, did_you_mean
from trunk_experiments.cli import main
from trunk_experiments.console.tables import print_table
from trunk_runs.plan import Swap, make_plan


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("simulat", "simulate"),
        ("Fuzzy_PID", "fuzzy_pid"),
        ("fuzzypid", "fuzzy_pid"),
        ("fig10", "fig1"),
        ("zzz", ""),
        ("", ""),
    ],
)
def test_the_closest_name(written, meant):
    assert closest(written, ["simulate", "fuzzy_pid", "pid", "fig1"]) == meant
    assert did_you_mean(written, ["simulate", "fuzzy_pid", "pid", "fig1"]) == (
        f"; did you mean {meant!r}?" if meant else ""
    )


TYPOS = [
    (("simulat", "fig8"), "did you mean 'simulate'?"),
    (("simulate", "fig10", "-o", "x.mcap"), "did you mean 'fig9'?"),
    (("simulate", "fig8", "--controller", "fuzzypid", "-o", "x.mcap"), "did you mean 'fuzzy_pid'?"),
    (
        ("simulate", "fig8", "--params", "pid_as_printd", "-o", "x.mcap"),
        "did you mean 'pid_as_printed'?",
    ),
    (("simulate", "fig8", "--set", "pidd.gains.p=1", "-o", "x.mcap"), "did you mean 'pid'?"),
    (("sweep", "robustnes", "-o", "x.parquet"), "did you mean 'robustness'?"),
]


@pytest.mark.parametrize(("words", "hint"), TYPOS, ids=lambda one: str(one)[:40])
def test_a_typo_gets_a_suggestion(words, hint, tmp_path, monkeypatch, trunk):
    monkeypatch.chdir(tmp_path)
    code, _, err = trunk(*words)
    assert code == 2
    assert re.search(rf"{re.escape(hint)}( \(see trunk [a-z ]+ --help\))?$", err.strip())
    assert list(tmp_path.iterdir()) == []


def test_the_version(trunk):
    assert trunk("--version") == (0, "trunk 0.1.0\n", "")


def test_a_value_for_a_node_that_does_not_run_is_refused():
    with pytest.raises(
        PlanError, match=r"--set pid\.gains\.p=4: no node of this run takes it: fuzzy"
    ):
        make_plan("fig8", "fuzzy_pid", settings=["pid.gains.p=4"])
    swapped = make_plan("fig8", "fuzzy_pid", settings=["pid.gains.p=4"], swaps=[Swap(1.0, "pid")])
    assert swapped.controllers["pid"].p == 4.0
    for node in ("simulator.max_effort=5.0", "disturbance.pulse.magnitude=1.0"):
        assert make_plan("fig8", "lqr", settings=[node]).warnings == ()


def parameters(folder: Path, *nodes: str) -> str:
    path = folder / "shared.yaml"
    path.write_text("".join(f"{n}:\n  ros__parameters:\n    gains.p: 7.0\n" for n in nodes))
    return str(path)


def test_a_file_that_changes_nothing_gets_a_warning(tmp_path):
    path = parameters(tmp_path, "pid", "lqr")
    (warning,) = make_plan("fig8", "fuzzy_pid", [path]).warnings
    assert warning.startswith(
        f"{path}: no node of this run uses anything in it: it is for pid, lqr;"
    )
    assert make_plan("fig8", "lqr", [path]).warnings == ()


@pytest.mark.parametrize("name", ["pid", "/robot1/pid", "robot1/pid", "/*/pid", "/**"])
def test_a_file_for_a_namespace_gets_no_warning(tmp_path, name):
    path = parameters(tmp_path, name)
    assert make_plan("fig8", "pid", [path], namespace="/robot1").warnings == ()


@pytest.mark.parametrize("name", ["/robot1/pid", "robot1/pid"])
@pytest.mark.parametrize("namespace", ["", "/other"])
def test_a_file_for_another_namespace_gets_a_warning_that_names_it(tmp_path, name, namespace):
    path = parameters(tmp_path, name)
    (warning,) = make_plan("fig8", "pid", [path], namespace=namespace).warnings
    assert f"it is for {name}; the run has {namespace}/simulator, {namespace}/pid, " in warning
    assert warning.endswith(": call the section pid, or run in the namespace /robot1")


@pytest.mark.parametrize("name", ["PID", "/**/pidd", "/robot/Pid"])
def test_a_misspelt_node_gets_a_warning(tmp_path, name):
    path = parameters(tmp_path, name, "pid")
    (warning,) = make_plan("fig8", "pid", [path]).warnings
    assert warning == f"{path}: no node is called {name.split('/')[-1]!r}; did you mean 'pid'?"


def test_nodes_of_other_projects_pass(tmp_path):
    assert make_plan("fig8", "pid", [parameters(tmp_path, "camera_driver", "pid")]).warnings == ()


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("simulator.initial.position=[0, 30]", "simulator: initial.position is 30 rad"),
        ("pid.reference.value=45", "pid: reference.value is 45 rad, which is 2578 degrees"),
        ("pid.reference.initial=-20", "pid: reference.initial is -20 rad"),
        ("simulator.plant.length=60", "simulator: plant.length is 60 m: lengths are in metres"),
    ],
)
def test_what_was_most_likely_meant_in_another_unit_gets_a_warning(setting, told):
    (warning,) = make_plan("fig8", "pid", settings=[setting]).warnings
    assert warning.startswith(told)


@pytest.mark.parametrize(
    "setting",
    [
        "simulator.initial.position=[30, 0.5]",
        "pid.reference.value=6.28",
        "simulator.fall.angle=inf",
        "simulator.plant.length=60m",
        "simulator.plant.length=9",
        "simulator.initial.velocity=[30, 30]",
    ],
)
def test_what_may_be_meant_gets_no_warning(setting):
    assert make_plan("fig8", "pid", settings=[setting]).warnings == ()


def test_a_swap_after_the_end_gets_a_warning():
    plan = make_plan("fig8", "pid", swaps=[Swap(40.0, "lqr")])
    assert plan.warnings == ("--swap-at 40:lqr: the run ends at 10 s, before that",)


def test_like_refuses_what_it_would_ignore(short_run, tmp_path, monkeypatch, capsys):
    run = short_run("fig6", "pid")
    for words in (
        ("--controller", "pid"),
        ("--set", "pid.gains.p=1"),
        ("--rate", "500"),
        ("--push", "1Nm:1s"),
        ("SCENARIO",),
    ):
        monkeypatch.setattr(
            sys,
            "argv",
            ["trunk", "simulate", "--like", str(run), *words, "-o", str(tmp_path / "x.mcap")],
        )
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code == 2
        assert f"--like has the whole run: leave out {words[0]}" in capsys.readouterr().err
    assert not (tmp_path / "x.mcap").exists()


def test_brackets_in_tables_are_text(capsys):
    print_table("[red]title[/red]", ("[b]name", "value"), [("a[/y]", "[effort_command]")])
    told = capsys.readouterr().out
    assert all(
        text in told for text in ("[red]title[/red]", "[b]name", "a[/y]", "[effort_command]")
    )
