"""A branch is its parent up to its time, and from then on what a run with the change would have been."""

import json
from dataclasses import replace

import pytest

from trunk_core.topics import Event
from trunk_evidence.branching import Branch, fanned
from trunk_evidence.differences import diff
from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.cli import main
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import Swap, make_plan
from trunk_runs.timeline import Change
from trunk_views.comparison import compare
from trunk_views.run_view import RunView

STEP = 5_000_000  # ns, at 200 Hz
AT = 500_000_000  # ns


@pytest.fixture(scope="module")
def plan():
    return make_plan(
        "demo",
        "pid",
        everywhere={"duration": 1.0},
        settings=("simulator.sensor.position_noise=0.001", "simulator.sensor.delay=0.02"),
    )


@pytest.fixture(scope="module")
def parent(plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("branch") / "parent.mcap"
    record_offline(plan, path)
    return path


def cli(capsys, *words):
    """Return the command's output, errors and exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["trunk", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
    out, err = capsys.readouterr()
    return out, err, ended.value.code or 0


@pytest.fixture
def branch(capsys):
    def made(parent, path, *words):
        _, told, code = cli(capsys, "branch", parent, "--at", "0.5", *words, "-o", path)
        assert code == 0, told
        return checked(parent, path)

    return made


def checked(parent, path):
    run = RecordedRun.open(path)
    verdict = verdict_on(run)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    first = diff(RecordedRun.open(parent), run).first
    assert first is None or first.stamp_ns >= AT
    return run


def same(run, plan, tmp_path):
    """Return whether a run is, bit for bit, what a plan gives from the start."""
    path = tmp_path / "oracle.mcap"
    record_offline(plan, path, overwrite=True)
    found = diff(RecordedRun.open(path), run)
    return found.identical or found.describe()


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "changes"),
    [
        (["--set", "pid.gains.p=95"], {"pid": [Change(AT - STEP, {"gains.p": 95.0})]}),
        (["--set", "simulator.max_effort=9"], {"simulator": [Change(AT, {"max_effort": 9.0})]}),
        (
            ["--set", "disturbance.sine.amplitude=25", "--set", "pid.reference.amplitude=5deg"],
            {
                "disturbance": [Change(AT - STEP, {"sine.amplitude": 25.0})],
                "pid": [Change(AT - STEP, {"reference.amplitude": 0.08726646259971647})],
            },
        ),
        (["--set", "pid.gains.p=60"], {}),  # its value anyway
    ],
)
def test_what_follows_is_what_a_run_with_the_change_does(
    branch, parent, plan, tmp_path, words, changes
):
    run = branch(parent, tmp_path / "b.mcap", *words)
    assert same(run, replace(plan, changes=changes), tmp_path) is True


def test_another_controller_takes_over_without_a_bump(branch, parent, plan, tmp_path):
    run = branch(parent, tmp_path / "b.mcap", "--controller", "lqr")
    other = make_plan("demo", "lqr", everywhere={"duration": 1.0}).controllers["lqr"]
    turns = {
        "pid": [Change(AT - STEP, None, Event.DEACTIVATED)],
        "lqr": [Change(AT - STEP, None, Event.ACTIVATED)],
    }
    both = replace(plan, controllers={**plan.controllers, "lqr": other}, changes=turns)
    assert same(run, both, tmp_path) is True
    commands = run.table("effort_command")
    before, after = (commands.get(at, "effort")[0] for at in (AT - STEP, AT))
    assert abs(after - before) <= other.handover_step


def test_a_branch_is_branched_back(branch, parent, tmp_path, capsys):
    branch(parent, tmp_path / "lqr.mcap", "--controller", "lqr")
    words = ("--at", 0.8, "--controller", "pid", "-o", tmp_path / "b.mcap")
    assert cli(capsys, "branch", tmp_path / "lqr.mcap", *words)[2] == 0
    run = RecordedRun.open(tmp_path / "b.mcap")
    assert verdict_on(run).exit_code == VERIFIED
    assert (run.branch.parent, run.branch.at) == ("lqr.mcap", 0.8)
    assert diff(RecordedRun.open(tmp_path / "lqr.mcap"), run).first.stamp_ns >= 800_000_000


def test_a_new_controller_without_a_shipped_scenario_has_its_defaults_and_that_is_said(
    plan, parent, tmp_path, capsys
):
    """The recording does not have the scenario's values for nodes that were not in the run."""
    own = tmp_path / "own.mcap"
    record_offline(replace(plan, scenario="own"), own)
    said = "trunk: warning: lqr has its defaults: own is no shipped scenario: give --set lqr.…\n"
    words = "--at", "0.8", "--controller", "lqr"
    assert cli(capsys, "branch", own, *words, "-o", tmp_path / "a.mcap")[1] == said
    given = "--set", "lqr.gains.p=70"
    assert cli(capsys, "branch", own, *words, *given, "-o", tmp_path / "b.mcap")[1] == ""
    assert cli(capsys, "branch", parent, *words, "-o", tmp_path / "c.mcap")[1] == ""


def test_a_branch_before_another_ones_turn_leaves_that_idle(branch, parent, tmp_path, capsys):
    """A controller that was to act later, by the first branch, does not act from the start."""
    branch(parent, tmp_path / "lqr.mcap", "--controller", "lqr")
    words = ("--at", 0.2, "--controller", "computed_torque", "-o", tmp_path / "b.mcap")
    _, told, code = cli(capsys, "branch", tmp_path / "lqr.mcap", *words)
    assert code == 0, told
    run = RecordedRun.open(tmp_path / "b.mcap")
    assert verdict_on(run).exit_code == VERIFIED
    assert run.count("lqr/state") == 0
    assert run.count("computed_torque/state") == 161


def test_pushes_act_when_they_say_and_the_rest_stays(branch, parent, tmp_path):
    run = branch(
        parent, tmp_path / "b.mcap", "--push", "60Nm:0.1s", "--push", "trunk_effort=-20:50ms@0.7s"
    )
    found = [p for p in RunView.read(run).pulses if p.channel == "trunk_effort"]
    assert [p[:2] for p in found] == [(0.5, 0.6), (0.7, 0.75)]
    assert [p.magnitude for p in found] == [60.0, -20.0]


def test_nothing_disturbed_the_past_of_a_run_without_disturbances(branch, tmp_path):
    path = tmp_path / "parent.mcap"
    record_offline(make_plan("fig6", "pid", everywhere={"duration": 0.9}), path)
    run = branch(path, tmp_path / "b.mcap", "--push", "hip_effort=200N:0.05s")
    assert run.table("disturbance").stamp_ns[0] == AT


@pytest.mark.slow
def test_a_branch_ends_when_asked_or_as_planned(branch, parent, plan, tmp_path):
    for end, states in ((0.75, 151), (2.0, 401)):
        run = branch(parent, tmp_path / f"{end}.mcap", "--duration", end)
        assert run.count("joint_states") == states
        longer = replace(plan, simulator=replace(plan.simulator, duration=end))
        assert same(run, longer, tmp_path) is True
    falls = make_plan(
        "demo", "pid", everywhere={"duration": 2.0},
        settings=("simulator.fall.stop=true", "pid.u_clamp_max=1", "pid.u_clamp_min=-1"),
    )  # fmt: skip
    record_offline(falls, tmp_path / "falls.mcap")
    assert RecordedRun.open(tmp_path / "falls.mcap").count("joint_states") < 401
    saved = branch(tmp_path / "falls.mcap", tmp_path / "saved.mcap",
                   "--set", "pid.u_clamp_max=500", "--set", "pid.u_clamp_min=-500")  # fmt: skip
    assert saved.count("joint_states") == 401


def twice(capsys, tmp_path, parent, first, second):
    """Branch a run, then its branch; return the second one's run, which verifies."""
    path = parent
    for i, words in enumerate((first, second)):
        out = tmp_path / f"{i}.mcap"
        _, told, code = cli(capsys, "branch", path, *words, "-o", out, "--force")
        assert code == 0, told
        verdict = verdict_on(RecordedRun.open(out))
        assert verdict.exit_code == VERIFIED, verdict.reasons
        path = out
    return RecordedRun.open(path)


@pytest.mark.slow
def test_a_controller_without_a_command_yet_is_kept(tmp_path, capsys):
    path = tmp_path / "swap.mcap"
    swap = make_plan("demo", "fuzzy_pid", everywhere={"duration": 1.0}, swaps=(Swap(2.0, "pid"),))
    record_offline(swap, path)
    run = twice(capsys, tmp_path, path, ("--at", 0.3), ("--at", 0.5, "--duration", 3))
    assert run.count("pid/state") == 201
    run = twice(
        capsys,
        tmp_path,
        path,
        ("--at", 0.3, "--duration", 2.5),
        ("--at", 2.2, "--controller", "lqr"),
    )
    assert list(run.controllers) == ["fuzzy_pid", "pid", "lqr"]
    late = ("--at", 0.5, "--controller", "pid", "--duration", 1)
    run = twice(capsys, tmp_path, path, ("--at", 0.1, "--controller", "lqr", "--duration", 1), late)
    assert run.count("pid/state") == 101
    scheduled = ("--at", 0, "--controller", "lqr", "--duration", 1, "-o", tmp_path / "x.mcap")
    assert "turn at t = 0 s that would undo it" in cli(capsys, "branch", path, *scheduled)[1]


@pytest.mark.slow
def test_changes_at_the_same_time_add_up(parent, plan, tmp_path, capsys):
    limited = ("--at", 0.5, "--set", "simulator.max_effort=5")
    run = twice(
        capsys, tmp_path, parent, limited, ("--at", 0.5, "--set", "simulator.max_effort=inf")
    )
    assert same(run, plan, tmp_path) is True
    at_once = ("--at", 0, "--set", "simulator.max_effort=20")
    run = twice(capsys, tmp_path, parent, at_once, ("--at", 0))
    changes = {"simulator": [Change(0, {"max_effort": 20.0})]}
    assert same(run, replace(plan, changes=changes), tmp_path) is True
    run = twice(
        capsys, tmp_path, parent, ("--at", 1, "--set", "simulator.max_effort=3"), ("--at", 0.5)
    )
    assert [one.changed for one in run.parameter_changes("simulator")] == [{"max_effort": 3.0}]


@pytest.mark.slow
def test_a_disturbance_that_joined_at_a_branch_is_kept_in_the_next(tmp_path, capsys):
    path = tmp_path / "quiet.mcap"
    record_offline(make_plan("fig6", "pid", everywhere={"duration": 0.9}), path)
    push = ("--push", "hip_effort=200N:0.05s")
    run = twice(capsys, tmp_path, path, ("--at", 0.3, *push), ("--at", 0.6))
    assert run.table("disturbance").stamp_ns[0] == 300_000_000
    twice(capsys, tmp_path, path, ("--at", 0.6, *push), ("--at", 0.3))
    later = ("--at", 0.2, "--push", "hip_effort=30N:1s")
    _, told, code = cli(capsys, "branch", tmp_path / "0.mcap", *later, "-o", tmp_path / "x.mcap")
    assert (code, "which would undo it: branch after that" in told) == (2, True)


def test_several_branches_and_a_fan_go_into_a_folder(parent, tmp_path, capsys):
    said = cli(capsys, "branch", parent, "--at", 0.3, "--controller", "lqr", "--at", 0.6, "--push", "9:0.1",
               "--grid", "simulator.max_effort=40,50", "-o", tmp_path / "fan", "--json")  # fmt: skip
    made = json.loads(said[0])["branches"]
    assert [(one["at_s"], one["changes"]) for one in made] == [
        (0.3, "controller lqr, simulator.max_effort=40"),
        (0.3, "controller lqr, simulator.max_effort=50"),
        (0.6, "simulator.max_effort=40, push 9:0.1"),
        (0.6, "simulator.max_effort=50, push 9:0.1"),
    ]
    assert len(list((tmp_path / "fan").glob("*.mcap"))) == 4
    assert fanned([Branch(1.0)], ()) == [Branch(1.0)]


def test_a_comparison_names_the_parent_and_ranks_no_pushed_branch(branch, parent, tmp_path):
    run = branch(parent, tmp_path / "b.mcap", "--push", "60Nm:0.1s")
    found = compare([RunView.read(RecordedRun.open(parent)), RunView.read(run)])
    assert found.branches[0] is None
    assert (
        found.branches[1]
        .describe()
        .startswith(
            "from t = 0.5 s on simulated with push 60Nm:0.1s: branch of parent.mcap, SHA-256 "
        )
    )
    assert "disturbance.table.values" in found.tasks
    assert not any(row.best for row in found.rows)
