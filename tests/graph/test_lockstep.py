"""Lock-step: processes and composed nodes give the bits of the offline run, under any load and order."""

import random
import signal
from pathlib import Path

import pytest

from trunk_evidence.recorded_run import RecordedRun
from trunk_runs.plan import make_plan

from ..same_bits.paths import difference, reference
from ..same_bits.scenarios import SCENARIOS
from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

ROOT = Path(__file__).parents[2]

# Through the library, since the command has no option for the start order.
RUN_IN_ORDER = """
import sys
from pathlib import Path

root, name, folder, *order = sys.argv[1:]
sys.path.insert(0, root)
from tests.same_bits.scenarios import SCENARIOS
from trunk_runs.run_files import RunFiles
from trunk_runs.graph import run_graph

run_graph(SCENARIOS[name].plan(lockstep=True), RunFiles(Path(folder)), lambda t: None, order)
"""
BUSY = "while True: pass"


@pytest.mark.parametrize(
    "name",
    [
        *("a gait", "a cart-pole", "files and random pulses", "a drive", "more links"),
        *(
            pytest.param(name, marks=pytest.mark.one_in(8))
            for name in ("fuzzy", "swaps", "disturbed")
        ),
    ],
)
def test_composed_nodes_have_the_bits_of_the_offline_run(
    children: Children, tmp_path: Path, name: str
) -> None:
    scenario = SCENARIOS[name]
    run = children.trunk("run", *scenario.words, "--lockstep", "--composed", "--output", "run")
    assert run.wait() == 0, run.stdout + run.stderr
    children.none_left()
    expected = reference(scenario.plan(lockstep=True), tmp_path)
    assert difference(expected, RecordedRun.open(tmp_path / "run" / "run.mcap")) == []


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("a slow controller", 3),
        pytest.param("fuzzy", 1, marks=pytest.mark.one_in(8)),
        pytest.param("more links", 2, marks=pytest.mark.one_in(8)),
    ],
)
def test_processes_started_in_any_order_beside_a_busy_one_have_them_too(
    children: Children, tmp_path: Path, name: str, seed: int
) -> None:
    plan, busy = SCENARIOS[name].plan(lockstep=True), children.python(BUSY, name="busy")
    order = list(plan.configs)
    random.Random(seed).shuffle(order)
    run = children.python(RUN_IN_ORDER, ROOT, name, tmp_path / "run", *order)
    assert run.wait() == 0, run.stdout + run.stderr
    assert busy.stop(signal.SIGTERM) == -signal.SIGTERM
    children.none_left()
    expected = reference(plan, tmp_path)
    assert difference(expected, RecordedRun.open(tmp_path / "run" / "run.mcap")) == []


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
