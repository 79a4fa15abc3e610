"""The demo: the whole graph in real time, and ``scripts/demo.sh`` with the same bits on any machine."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

from trunk_core import topics
from trunk_evidence.differences import diff
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from ..same_bits.scenarios import SCENARIOS
from .processes import Children
from .recordings import assert_every_step, finished_file, joints

pytestmark = pytest.mark.graph

DURATION_S = 3
PERIOD_NS = 5_000_000
STATES = DURATION_S * 200 + 1


def test_demo(children: Children, tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    run = children.trunk("run", "demo", "--duration", DURATION_S, "--output", folder)
    assert run.wait() == 0, run.stderr
    children.none_left()
    for text in ("metrics of the run", "overshoot", "peak torque", "complete: 601 states"):
        assert text in run.stdout
    assert f"recording: {folder / 'run.mcap'}" in run.stdout.replace("\n", "")
    assert "Traceback" not in run.stderr

    recording = Recording.open(folder / "run.mcap")
    assert recording.complete, recording.warnings
    assert recording.warnings == []
    assert_every_step(recording, PERIOD_NS, STATES)
    answered = joints(recording, topics.EFFORT_COMMAND).stamp_ns
    assert len(answered)
    assert len(np.unique(answered)) == len(answered)
    assert np.isin(answered, joints(recording, topics.JOINT_STATES).stamp_ns).all()

    nodes = yaml.safe_load((folder / "params.yaml").read_text())
    assert set(nodes) == {"/recorder", "/fuzzy_pid", "/disturbance", "/simulator"}
    simulator = nodes["/simulator"]["ros__parameters"]
    assert (simulator["update_rate"], simulator["duration"]) == (200.0, 3.0)

    # How late commands arrive depends on the machine; what is done with each does not.
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    assert_readable_by_all(folder / "run.mcap")


@pytest.mark.one_in(4)
def test_the_demo_script_ends_with_a_verdict_a_page_and_what_to_try_next(
    children: Children, tmp_path: Path
) -> None:
    """At another pace, which changes nothing else."""
    script = Path(__file__).parents[2] / "scripts" / "demo.sh"
    run = children.start("demo", "bash", script, "--output", "demo", "--speed", 10)
    assert run.wait() == 0, run.stderr
    children.none_left()
    said = run.stdout.splitlines()
    assert "demo: verified" in said
    page = tmp_path / "demo" / "report.html"
    assert f"report: {page.as_uri()}" in said
    assert page.stat().st_size > 300_000
    assert [line.split()[:2] for line in said[-3:]] == [
        ["trunk", "explain"],
        ["trunk", "branch"],
        ["trunk", "live"],
    ]
    record_offline(make_plan("demo", "fuzzy_pid"), tmp_path / "offline.mcap")
    names = ("offline.mcap", "demo/run.mcap")
    assert diff(*(RecordedRun.open(tmp_path / name) for name in names)).identical
    assert "LATE" not in run.stdout + run.stderr


@pytest.mark.parametrize(
    "name",
    [
        "a cart-pole",
        pytest.param("a drive", marks=pytest.mark.one_in(8)),
        pytest.param("more links", marks=pytest.mark.one_in(8)),
    ],
)
def test_a_run_in_real_time_verifies(children: Children, tmp_path: Path, name: str) -> None:
    """With real drives, sensors and links; with another plant."""
    run = children.trunk("run", *SCENARIOS[name].words, "-o", "run")
    assert run.wait() == 0, run.stderr
    verdict = verify(Recording.open(tmp_path / "run" / "run.mcap"))
    assert verdict.exit_code == VERIFIED, verdict.reasons
    children.none_left()


def assert_readable_by_all(path: Path) -> None:
    """Assert that three independent readers decode every message and count the same number."""
    by_mcap = finished_file(path)
    by_mcap_ros2 = Counter(
        message.channel.topic for message in read_ros2_messages(path) if message.ros_msg
    )
    by_rosbags: Counter[str] = Counter()
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            by_rosbags[connection.topic] += 1
    assert by_mcap == by_mcap_ros2 == by_rosbags
    assert set(by_mcap) == {
        "/joint_states",
        "/ground_truth/joint_states",
        "/effort_command",
        "/disturbance",
        "/plant/inputs",
        "/fuzzy_pid/state",
        "/run/parameters",
        "/run/events",
    }
