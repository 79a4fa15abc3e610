"""Lock-step: processes, composed nodes and the offline run give the same bits, under any load and order."""

from __future__ import annotations

import csv
import random
import re
import signal
from pathlib import Path

import pytest

from trunk_experiments.plans.plan import make_plan

from .peer import Peer
from .processes import Child, Children
from .verbs import said, verified

pytestmark = pytest.mark.graph

# Through the library, since the command has no option for the start order.
RUN_IN_ORDER = """
import sys
from pathlib import Path
from trunk_experiments.runs.files import RunFiles
from trunk_experiments.runs.graph import run_graph
from trunk_experiments.plans.plan import make_plan

folder, controller, rate, duration, *order = sys.argv[1:]
plan = make_plan(
    "fig8", controller, settings=[f"{controller}.update_rate={rate}"],
    everywhere={"duration": float(duration), "lockstep.enabled": True},
)
run_graph(plan, RunFiles(Path(folder)), lambda t: None, order)
"""
BUSY = "while True: pass"


def succeed(child: Child) -> None:
    assert child.wait() == 0, child.stdout + child.stderr


@pytest.mark.parametrize(
    ("controller", "rate", "duration", "seed"),
    [
        pytest.param("fuzzy_pid", 1000.0, 1.5, 1, marks=pytest.mark.long),
        pytest.param("pid", 1000.0, 1.5, 2, marks=pytest.mark.long),
        ("fuzzy_pid", 250.0, 0.5, 3),
    ],
    ids=["fuzzy_pid", "pid", "fuzzy_pid at a quarter of the plant's rate"],
)
def test_same_bits_everywhere(
    children: Children, tmp_path: Path, controller: str, rate: float, duration: float, seed: int
) -> None:
    options = ("fig8", "--controller", controller, "--duration", duration)
    options += ("--set", f"{controller}.update_rate={rate}")
    order = ["recorder", controller, "disturbance", "simulator"]
    random.Random(seed).shuffle(order)
    offline, processes, composed = (
        tmp_path / name for name in ("offline.mcap", "processes/run.mcap", "composed/run.mcap")
    )
    said("simulate", *options, "-o", offline)
    load = [children.python(BUSY, name=f"busy-{i}") for i in range(1)]
    succeed(children.python(RUN_IN_ORDER, processes.parent, controller, rate, duration, *order))
    for busy in load:
        assert busy.stop(signal.SIGTERM) == -signal.SIGTERM
    succeed(
        children.trunk("run", *options, "--lockstep", "--composed", "--output", composed.parent)
    )
    children.none_left()

    steps, updates = round(duration * 1000) + 1, round(duration * rate) + 1
    messages = 4 * steps + 1 + updates  # the disturbance is published one step ahead
    for run in (processes, composed):
        assert f"identical: {messages} messages" in said("diff", offline, run)
    for run in (offline, processes, composed):
        assert re.search(rf"states of the plant .* {steps} +verified", verified(run))


def test_same_bits_on_a_custom_hip_path(children: Children, tmp_path: Path) -> None:
    options = ["fig8", "--controller", "computed_torque", "--duration", "0.4"]
    for prefix in ("simulator.path.", "computed_torque.model.path_"):
        options += [
            "--set",
            f"{prefix}cosines=[0.004, -0.012]",
            "--set",
            f"{prefix}sines=[0.0, 2cm]",
        ]
    offline, composed = tmp_path / "offline.mcap", tmp_path / "composed" / "run.mcap"
    said("simulate", *options, "-o", offline)
    run = ("run", *options, "--lockstep", "--composed", "--output", composed.parent)
    succeed(children.trunk(*run))
    children.none_left()
    assert "identical" in said("diff", offline, composed)
    verified(composed)


def test_incommensurate_rate_is_refused_by_the_run(children: Children, tmp_path: Path) -> None:
    run = children.trunk(
        "run", "fig8", "--lockstep", "--set", "fuzzy_pid.update_rate=300.0", "--output", "refused"
    )
    assert run.wait() == 2
    (line,) = run.stderr.splitlines()
    assert "update_rate 300 Hz is not an integer divisor of the simulator's 1000 Hz" in line
    assert not (tmp_path / "refused").exists()


def test_incommensurate_rate_is_refused_by_the_node(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    plan = make_plan("fig8", "fuzzy_pid", everywhere={"lockstep.enabled": True, "duration": 0.5})
    plan.write_parameters(tmp_path / "params.yaml")
    files = ("--params-file", tmp_path / "params.yaml")
    controller = children.node("fuzzy_pid", *files, "fuzzy_pid:update_rate:=300.0")
    peer.until_up("fuzzy_pid")
    simulator = children.node("simulator", *files, "simulator:lockstep.timeout:=3600.0")
    others = [
        simulator,
        children.node("disturbance", *files),
        children.node("recorder", *files, "recorder:output:=run.mcap"),
    ]
    ended = peer.until(
        lambda: [c for c in (controller, simulator) if c.process.poll() is not None],
        "the controller refuses",
    )
    for child in (controller, *others):
        short = child.name in ("simulator", "recorder")  # of the run's end
        assert child in ended or child.stop() == short, child.stderr
    assert controller.process.returncode == 1
    (line,) = [one for one in controller.stderr.splitlines() if "is not allowed" in one]
    assert "update_rate = 300 Hz is not allowed in lock-step with a plant at 1000 Hz" in line
    assert peer.until_event("fuzzy_pid", "failed").values["reason"] in line


# A reference and a push from CSV files, and pulses at random times: all of it known before the run.
CSV = {
    "ref.csv": "t [ms],reference [deg]\n0,0\n200,15\n200,5\n400,-10\n",
    "push.csv": "t [s],value [N*m]\n0.1,0\n0.15,3\n0.3,-1\n",
}
FROM_CSV = (
    *("--set", "pid.reference.profile=file", "--set", "pid.reference.file=ref.csv"),
    *("--set", "disturbance.table.file=push.csv", "--set", "disturbance.pulse.start_times=[0.05]"),
    *("--set", "disturbance.pulse.duration=20ms", "--set", "disturbance.pulse.magnitude=10deg"),
    *("--set", "disturbance.pulse.random_count=3", "--set", "disturbance.pulse.random_until=0.5"),
)


def test_nodes_follow_csv_files_and_random_pulses_as_the_offline_run_does(
    children: Children, tmp_path: Path
) -> None:
    for name, text in CSV.items():
        (tmp_path / name).write_text(text)
    options = ("demo", "--controller", "pid", "--duration", 0.5, *FROM_CSV)
    offline, composed = tmp_path / "offline.mcap", tmp_path / "composed/run.mcap"
    succeed(children.trunk("simulate", *options, "-o", offline))
    run = ("run", *options, "--lockstep", "--composed", "--output", composed.parent)
    succeed(children.trunk(*run))
    children.none_left()
    assert "identical: " in said("diff", offline, composed)
    assert re.search("disturbances .* 102 +verified", verified(composed))
    table = tmp_path / "run.csv"
    said("export", composed, "--csv", table)
    with table.open(newline="") as file:
        references = {row["reference"] for row in csv.DictReader(file)}
    assert len(references) > 50
