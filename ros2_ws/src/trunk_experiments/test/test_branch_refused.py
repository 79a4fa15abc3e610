"""What cannot be branched is refused in one line and leaves no file; where pushes can be added."""

from dataclasses import replace

import pytest

from trunk_core.errors import PlanError
from trunk_evidence.recorded_run import branch_of
from trunk_experiments.commands import branch as branch_verb
from trunk_runs.timeline import Push, parse_push, pushed
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import disturbance_at
from trunk_sim.plants.trunk import PLANT


@pytest.fixture
def parent(short_run):
    return short_run("demo", "pid", duration=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--at", "1.5"], "--at 1.5: outside the run, t = 0 to 1 s"),
        (["--at", "-1"], "--at -1: outside the run"),
        (["--at", "nan"], "nan"),
        (["--set", "pid.gains.p=1", "--at", "0.5"], "--set pid.gains.p=1: give --at T first"),
        (["--at", "0.5", "--set", "pid.update_rate=100"], "--set pid.update_rate: it is fixed"),
        (
            ["--at", "0.5", "--set", "simulator.duration=3"],
            "--duration gives the branch another end",
        ),
        (["--at", "0.5", "--set", "lqr.gains.p=3"], "--controller adds a controller"),
        (["--at", "0.5", "--set", "pid.gain.p=3"], "did you mean"),
        (["--at", "0.5", "--controller", "pid"], "it already acts at t = 0.5 s"),
        (
            ["--at", "0.5", "--controller", "lqr", "--controller", "lqr"],
            "give only one for each --at",
        ),
        (["--at", "0.5", "--push", "60"], "VALUE:DURATION"),
        (["--at", "0.5", "--push", "60Nm:-1s"], "above 0 s"),
        (["--at", "0.5", "--push", "nan:1s"], "VALUE:DURATION"),
        (["--at", "0.5", "--push", "60kg:1s"], "kg"),
        (["--at", "0.5", "--push", "60:1@0.2"], "give a time from 0.5 s on"),
        (["--at", "0.5", "--push", "x=60:1"], "CHANNEL one of"),
        (["--at", "0.5", "--push", "1:1", "--push", "hip_effort=1:1"], "pushes on one channel"),
        (["--at", "0.5", "--duration", "0.2"], "--duration 0.2: the branch begins at t = 0.5 s"),
        (["--at", "0.5", "--duration", "inf"], "duration"),
        (["--at", "0.5", "--duration", "2e6"], "duration"),
        (["--at", "0.5", "--push", "1Nm:0.1s@5s"], "the branch ends at t = 1 s"),
        (["--at", "0.5", "--push", "1Nm:1e-12s"], "above 0 s"),
        (["--at", "0.5", "--grid", "pid.gains.p"], "NODE.PARAM=A,B,C is needed"),
        (["--at", "0.5", "--at", "0.6"], "2 branches: name a folder"),
    ],
)
def test_what_cannot_be_branched_is_refused_in_one_line(
    parent, tmp_path, command_says, words, said
):
    code, _, told = command_says("branch", parent, *words, "-o", tmp_path / "b.mcap")
    assert code == 2
    assert said in told
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "b.mcap").exists()


def test_refused_branches_leave_nothing(parent, tmp_path, command_says):
    for words in (
        ("--at", 0.1, "--at", 5),
        ("--at", 0.1, "--grid", "simulator.max_effort=3,-4"),
        ("--at", 0.1, "--at", 0.1),
    ):
        code, _, told = command_says("branch", parent, *words, "-o", tmp_path / "folder")
        assert (code, len(told.splitlines())) == (2, 1)
        assert not (tmp_path / "folder").exists()
    long = [
        word for p in "pid" for word in ("--set", f"pid.gains.{p}=12.3456789012345678901234567890")
    ]
    grid = ("--grid", "simulator.actuator.coulomb_friction=0.1,0.2")
    assert (
        command_says("branch", parent, "--at", 0.9, *long, *grid, "-o", tmp_path / "long")[0] == 0
    )
    assert len(list((tmp_path / "long").iterdir())) == 2


def test_checking_many_branches_is_said(parent, tmp_path, command_says, monkeypatch):
    monkeypatch.setattr(branch_verb, "_MANY", 3)
    words = ("--at", 0.1, "--grid", "simulator.max_effort=3,4,5,-4", "-o", tmp_path / "folder")
    _, _, told = command_says("branch", parent, *words)
    assert "trunk: checking branches: 75 %" in told


def test_one_branch_goes_into_a_folder_too(parent, tmp_path, command_says):
    folder = tmp_path / "new" / "folder"
    code, told, _ = command_says("branch", parent, "--at", 0.5, "-o", folder)
    assert (code, len(list(folder.glob("*.mcap")))) == (0, 1), told


def test_a_push_is_added_to_a_held_table_and_to_no_other():
    held = DisturbanceConfig(
        table_times=(0.2, 0.6), table_values=(5.0, 0.0), table_interpolation="hold"
    )
    push = parse_push("60Nm:0.1s", 0.5, PLANT)
    assert push == Push("trunk_effort", 60.0, 0.5, 0.1)
    changed = pushed(held, [push])
    after = replace(held, table_times=changed["table.times"], table_values=changed["table.values"])
    for ms, torque in ((199, 0), (200, 5), (499, 5), (500, 65), (599, 65), (600, 0), (700, 0)):
        assert disturbance_at(ms * 1_000_000, after.signals).trunk_torque == torque
    drawn = replace(held, table_interpolation="linear")
    assert pushed(drawn, [push])["pulse.start_times"] == (0.5,)
    with pytest.raises(PlanError, match="one kind of pulse"):
        pushed(replace(drawn, pulse_start_times=(0.1,)), [push])


def test_provenance_of_no_branch_gives_none():
    assert branch_of({}) is None
    told = {"branch_of": "a", "branch_parent": "b", "branch_at": "inf", "branch_changes": ""}
    assert branch_of(told) is None
    assert branch_of({**told, "branch_at": "x"}) is None
    assert branch_of({**told, "branch_at": "1.5"}).at == 1.5
