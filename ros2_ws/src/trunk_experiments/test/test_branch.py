"""A branch is its parent up to its time, and from then on what a run with the change would have been."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import pytest
from mcap.reader import make_reader

from trunk_experiments.branching.branch import Branch, fanned
from trunk_experiments.branching.pushes import Push, parse_push, pushed
from trunk_experiments.cli import main
from trunk_experiments.errors import PlanError
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.plans.turns import Swap
from trunk_experiments.recorded.branch_of import branch_of
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import UNJUDGED, VERIFIED, verdict_on
from trunk_experiments.runs.offline_recording import record_offline
from trunk_experiments.views.compare import compare
from trunk_experiments.views.run_view import RunView
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.writer import PROVENANCE, RecordingWriter
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_sim.disturbances import disturbance_at

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
    """Return what the command prints, its mistakes and its exit code."""
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
        (["--set", "pid.gains.p=60"], {}),  # what it is anyway
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


def test_a_branch_ends_when_it_is_told_or_was_planned(branch, parent, plan, tmp_path):
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


def test_a_controller_that_has_given_no_command_yet_is_there(tmp_path, capsys):
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


def test_a_disturbance_that_joined_at_a_branch_is_there_in_the_next(tmp_path, capsys):
    path = tmp_path / "quiet.mcap"
    record_offline(make_plan("fig6", "pid", everywhere={"duration": 0.9}), path)
    push = ("--push", "hip_effort=200N:0.05s")
    run = twice(capsys, tmp_path, path, ("--at", 0.3, *push), ("--at", 0.6))
    assert run.table("disturbance").stamp_ns[0] == 300_000_000
    twice(capsys, tmp_path, path, ("--at", 0.6, *push), ("--at", 0.3))
    later = ("--at", 0.2, "--push", "hip_effort=30N:1s")
    _, told, code = cli(capsys, "branch", tmp_path / "0.mcap", *later, "-o", tmp_path / "x.mcap")
    assert (code, "which would undo it: branch after that" in told) == (2, True)


def test_disturbances_that_acted_before_a_branch_have_to_be_there(parent, tmp_path, capsys):
    """Whoever takes them out of a branch is found: their node was not quiet by its parameters."""
    out = tmp_path / "b.mcap"
    assert cli(capsys, "branch", parent, "--at", 0.5, "-o", out)[2] == 0
    path = tmp_path / "edited.mcap"
    with out.open("rb") as file, RecordingWriter(path) as writer:
        writer.add_metadata(PROVENANCE, RecordedRun.open(out).recording.provenance)
        for schema, channel, message in make_reader(file).iter_messages():
            number = writer.channel(channel.topic, schema.name)
            if channel.topic != "/disturbance" or message.log_time >= AT:
                writer.write(number, message.log_time, message.publish_time, message.data)
    verdict = verdict_on(RecordedRun.open(path))
    assert verdict.exit_code != VERIFIED
    assert "disturbance: 100 steps missing, the first at t = 0 s" in verdict.obstacles


def test_nothing_is_left_of_branches_that_cannot_be(parent, tmp_path, capsys):
    for words in (
        ("--at", 0.1, "--at", 5),
        ("--at", 0.1, "--grid", "simulator.max_effort=3,-4"),
        ("--at", 0.1, "--at", 0.1),
    ):
        _, told, code = cli(capsys, "branch", parent, *words, "-o", tmp_path / "folder")
        assert (code, len(told.splitlines())) == (2, 1)
        assert not (tmp_path / "folder").exists()
    long = [
        word for p in "pid" for word in ("--set", f"pid.gains.{p}=12.3456789012345678901234567890")
    ]
    grid = ("--grid", "simulator.actuator.coulomb_friction=0.1,0.2")
    assert cli(capsys, "branch", parent, "--at", 0.9, *long, *grid, "-o", tmp_path / "long")[2] == 0
    assert len(list((tmp_path / "long").iterdir())) == 2


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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--at", "1.5"], "--at 1.5: outside of the run, t = 0 to 1 s"),
        (["--at", "-1"], "--at -1: outside of the run"),
        (["--at", "nan"], "nan"),
        (["--set", "pid.gains.p=1", "--at", "0.5"], "--set pid.gains.p=1: give --at T first"),
        (["--at", "0.5", "--set", "pid.update_rate=100"], "--set pid.update_rate: it is fixed"),
        (
            ["--at", "0.5", "--set", "simulator.duration=3"],
            "--duration gives the branch another end",
        ),
        (["--at", "0.5", "--set", "lqr.gains.p=3"], "--controller makes one act"),
        (["--at", "0.5", "--set", "pid.gain.p=3"], "did you mean"),
        (["--at", "0.5", "--controller", "pid"], "it acts at t = 0.5 s anyway"),
        (["--at", "0.5", "--controller", "lqr", "--controller", "lqr"], "one for each --at"),
        (["--at", "0.5", "--push", "60"], "VALUE:DURATION"),
        (["--at", "0.5", "--push", "60Nm:-1s"], "above 0 s"),
        (["--at", "0.5", "--push", "nan:1s"], "VALUE:DURATION"),
        (["--at", "0.5", "--push", "60kg:1s"], "kg"),
        (["--at", "0.5", "--push", "60:1@0.2"], "before the branch at 0.5 s"),
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
def test_what_cannot_be_branched_is_a_line(parent, tmp_path, capsys, words, said):
    _, told, code = cli(capsys, "branch", parent, *words, "-o", tmp_path / "b.mcap")
    assert code == 2
    assert said in told
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "b.mcap").exists()


def test_a_push_is_added_to_a_held_table_and_to_no_other():
    held = DisturbanceConfig(
        table_times=(0.2, 0.6), table_values=(5.0, 0.0), table_interpolation="hold"
    )
    push = parse_push("60Nm:0.1s", 0.5)
    assert push == Push("trunk_effort", 60.0, 0.5, 0.1)
    changed = pushed(held, [push])
    after = replace(held, table_times=changed["table.times"], table_values=changed["table.values"])
    for ms, torque in ((199, 0), (200, 5), (499, 5), (500, 65), (599, 65), (600, 0), (700, 0)):
        assert disturbance_at(ms * 1_000_000, after.signals).trunk_torque == torque
    drawn = replace(held, table_interpolation="linear")
    assert pushed(drawn, [push])["pulse.start_times"] == (0.5,)
    with pytest.raises(PlanError, match="one kind of pulse"):
        pushed(replace(drawn, pulse_start_times=(0.1,)), [push])


def edited(source, path, change):
    """Copy a recording with one value of its true states changed, digests and all."""
    with source.open("rb") as file, RecordingWriter(path) as writer:
        writer.add_metadata(PROVENANCE, RecordedRun.open(source).recording.provenance)
        channels = {}
        for schema, channel, message in make_reader(file).iter_messages():
            number = channels.setdefault(channel.topic, writer.channel(channel.topic, schema.name))
            data = change(channel.topic, message)
            writer.write(number, message.log_time, message.publish_time, data)
    return path


@pytest.mark.parametrize("topic", ["/ground_truth/joint_states", "/effort_command", "/disturbance"])
def test_what_does_not_verify_up_to_there_is_refused(parent, tmp_path, capsys, topic):
    def changed(name, message):
        if name != topic or message.log_time != 300_000_000:
            return message.data
        return message.data[:-8] + struct.pack("<d", 0.25)

    path = edited(parent, tmp_path / "edited.mcap", changed)
    before = cli(capsys, "branch", path, "--at", 0.29, "-o", tmp_path / "a.mcap")
    assert before[2] == 0, before
    _, told, code = cli(capsys, "branch", path, "--at", 0.5, "-o", tmp_path / "b.mcap")
    assert code == 2
    assert "it cannot be branched at t = 0.5 s, it does not verify up to there: t = 0.3 s" in told


def test_a_file_that_ends_early_is_branched_as_far_as_it_goes(parent, tmp_path, capsys):
    path = tmp_path / "cut.mcap"
    path.write_bytes(parent.read_bytes()[: parent.stat().st_size * 3 // 5])
    if verdict_on(RecordedRun.open(path)).exit_code != UNJUDGED:
        pytest.skip("the cut took everything")
    last = RecordedRun.open(path).count("ground_truth/joint_states")
    if last:
        assert cli(capsys, "branch", path, "--at", 0, "-o", tmp_path / "b.mcap")[2] == 0


def test_a_comparison_tells_whose_branch_a_run_is_and_ranks_no_pushed_one(branch, parent, tmp_path):
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


def test_what_is_no_branch_says_so():
    assert branch_of({}) is None
    told = {"branch_of": "a", "branch_parent": "b", "branch_at": "inf", "branch_changes": ""}
    assert branch_of(told) is None
    assert branch_of({**told, "branch_at": "x"}) is None
    assert branch_of({**told, "branch_at": "1.5"}).at == 1.5
