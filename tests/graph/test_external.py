"""A controller that is not ours: connected, recorded, measured and judged as ours are."""

import json
import signal
import sys
from importlib.util import find_spec
from pathlib import Path
from shutil import which

import pytest

from trunk_core import topics
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun

from .processes import Child, Children
from .verbs import said

pytestmark = pytest.mark.graph

_EXAMPLES = Path(__file__).parents[2] / "examples" / "nodes"
_FOREIGN = Path(__file__).with_name("foreign_node.py")
# As docs/controllers.md has it: no multicast, and whoever listens on this machine.
_LOOPBACK = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast><Interfaces>"
    '<NetworkInterface name="lo"/><NetworkInterface autodetermine="true"/></Interfaces></General><Discovery>'
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    '<Peers><Peer Address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)
_SAME_LAW = ("--set", "pid.gains.p=60", "--set", "pid.gains.i=0", "--set", "pid.gains.d=9")


def foreign(children: Children, *faults: str) -> Child:
    return children.start("foreign", sys.executable, _FOREIGN, *faults)


def example(children: Children, name: str) -> Child:
    """Start one of the examples; skip, by name, where it cannot be had."""
    if name == "rclpy":
        return children.start(name, sys.executable, _EXAMPLES / "pd_rclpy.py")
    if name == "cyclonedds":
        if find_spec("cyclonedds") is None:
            pytest.skip("cyclonedds: pip install -r requirements/cyclonedds.txt")
        return children.start(name, sys.executable, _EXAMPLES / "pd_cyclonedds.py")
    if which("idlc") is None or not Path("/usr/include/dds/dds.h").exists():
        pytest.skip("idlc: apt-get install cyclonedds-dev cyclonedds-tools")
    built = children.folder / "cyclonedds_c"
    built.mkdir()
    for file in ("pd.c", "JointState.idl", "Makefile"):
        (built / file).write_bytes((_EXAMPLES / "cyclonedds_c" / file).read_bytes())
    assert children.start("make", "make", "-C", built).wait() == 0
    return children.start(name, built / "pd")


@pytest.mark.parametrize("name", ["rclpy", "cyclonedds", "c"])
def test_an_example_in_lockstep_has_the_bits_of_the_same_law(
    children: Children, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", _LOOPBACK)
    node = example(children, name)
    run = children.trunk(
        *("run", "demo", "--duration", 1.2, "--lockstep", "--external", "mine", "--output", "run")
    )
    assert run.wait() == 0, run.stderr
    assert "connect your node" in run.stderr
    assert "connected: " in run.stderr
    node.stop(signal.SIGKILL)
    theirs = RecordedRun.open(tmp_path / "run" / "run.mcap")
    assert theirs.external == "mine"
    verdict = verify(theirs.recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert [c.result for c in verdict.checks if "mine" in c.name] == ["taken as recorded"]
    own = ("--controller", "pid", "--duration", 1.2, *_SAME_LAW)
    said("simulate", "demo", *own, "-o", tmp_path / "ours.mcap")
    same = RecordedRun.open(tmp_path / "ours.mcap")
    for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES):
        for quantity in ("position", "velocity", "effort"):
            a, b = (run.table(topic).values(quantity) for run in (theirs, same))
            assert a.tobytes() == b.tobytes()
    if name != "rclpy":
        return
    monkeypatch.chdir(tmp_path)
    for verb in (
        ("metrics", "run"),
        ("compare", "run", "ours.mcap"),
        ("branch", "run/run.mcap", "--at", 1, "--controller", "pid", "-o", "branch.mcap"),
        ("verify", "branch.mcap"),
        ("metrics", "branch.mcap"),
        ("report", "run", "-o", "report.html"),
        ("plot", "run", "-o", "plot.png"),
        ("info", "--check", "run"),
    ):
        said(*verb)
    assert "torque from mine" in said("explain", "run", "--at", 1)
    assert "torque from mine" in said("explain", "branch.mcap", "--at", 0.9)
    assert "t = 1.1 s: pid holds" in said("explain", "branch.mcap", "--at", 1.1)
    refused = children.trunk("simulate", "--like", "run/run.mcap", "-o", "again.mcap", name="like")
    assert refused.wait() != 0
    assert "mine gave its commands" in refused.stderr


@pytest.mark.parametrize(
    ("fault", "word", "says", "acts"),
    [
        ("wall", "STAMPS", "commands with a clock's stamp: they act when they arrive", True),
        pytest.param(
            *("zero", "STAMPS", "commands without a stamp: they act when they arrive", True),
            marks=pytest.mark.one_in(8),
        ),
        ("hip", "REFUSED", "commands without the joint: their names are ['hip']", False),
        ("best_effort", "", "", True),
        pytest.param("copies_the_header", "", "", True, marks=pytest.mark.one_in(8)),
    ],
)
def test_in_real_time_each_habit_is_named(
    children: Children, tmp_path: Path, fault: str, word: str, says: str, acts: bool
) -> None:
    node = foreign(children, f"/={fault}")
    run = children.trunk(
        *("run", "fig6", "--composed", "--duration", 1, "--rate", 200),
        # On a busy machine the answer to the first state may come late; its stamp is that of no stamp.
        *("--set", "simulator.command_timeout=1"),
        *("--external", "--json", "--output", "run"),
    )
    code = run.wait()
    node.stop(signal.SIGKILL)
    doubts = json.loads(run.stdout)["doubts"]
    # On a busy machine the recorder may miss what a publisher no longer keeps, and then says so.
    lost = "was not recorded" in (doubts["reason"] or "")
    assert code == (1 if lost else 0 if acts else 2), run.stdout + run.stderr
    silent = "no command from foreign_pd was in force (0 of 200 steps)"
    assert doubts["silent"] == (None if acts else silent)
    assert [line.partition(":")[0] for line in doubts["refused"]] == ([word] if word else [])
    assert all(says in line for line in doubts["refused"])
    assert says in run.stderr
    recorded = RecordedRun.open(tmp_path / "run" / "run.mcap")
    assert recorded.external == "foreign_pd"
    assert bool(recorded.table(topics.GROUND_TRUTH).values("effort").any()) == acts
    if not acts:
        assert doubts["late"]["steps"] == 0  # nothing came late: nothing came
    verdict = verify(recorded.recording)
    assert verdict.exit_code == (VERIFIED if acts and not lost else UNJUDGED), verdict.reasons


@pytest.mark.parametrize("policy", ["durability", "deadline"])
def test_a_node_that_hears_nothing_is_silent_and_its_policy_named(
    children: Children, policy: str
) -> None:
    node = foreign(children, f"/={policy}")
    words = ("run", "fig6", "--composed", "--duration", 1, "--external", "mine", "--output", "run")
    run = children.trunk(*words)
    assert run.wait() == 2, run.stdout + run.stderr
    assert run.stdout.startswith("SILENT: no command from mine was in force (0 of 1000 steps)\n"), (
        run.stdout
    )
    fault = f"/foreign_pd subscribes to /joint_states with a {policy} that does not fit"
    assert fault in run.stderr
    assert fault in run.stdout  # REFUSED
    for verb in ("info", "verify", "metrics"):
        shown = children.trunk(verb, "run", name=verb)
        assert shown.wait() == (2 if verb == "verify" else 0)
        assert shown.stdout.startswith(
            "SILENT: no command from mine was in force (0 of 1000 steps)\n"
        )
    node.stop(signal.SIGKILL)


def test_in_lockstep_the_wall_clocks_stamps_end_the_run(children: Children) -> None:
    node = foreign(children, "/=wall")
    run = children.trunk(
        *("run", "fig6", "--composed", "--duration", 1, "--lockstep", "--external", "-o", "run")
    )
    assert run.wait() == 1
    assert (
        "/foreign_pd (effort_command): in lock-step its commands must answer states" in run.stderr
    )
    assert "copy header.stamp of the state" in run.stderr
    node.stop(signal.SIGKILL)


def test_two_strangers_are_named(children: Children) -> None:
    nodes = (
        foreign(children, "/=none", "/other=none"),
        children.start("second", sys.executable, _EXAMPLES / "pd_rclpy.py"),
    )
    run = children.trunk(
        *("run", "fig6", "--composed", "--duration", 1, "--external", "--output", "run")
    )
    assert run.wait() == 1
    assert "2 nodes publish /effort_command: /foreign_pd, /my_pd" in run.stderr
    for node in nodes:
        node.stop(signal.SIGKILL)
