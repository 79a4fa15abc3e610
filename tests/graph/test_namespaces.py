"""Two node sets side by side, each in its namespace: neither receives anything from the other."""

import shlex
import signal
from pathlib import Path

import pytest

from trunk_runs.processes import find_executable

from .processes import Child, Children, until
from .verbs import said, verified

pytestmark = pytest.mark.graph

# The same topics but for the namespace, and different bits: a message that crossed over would show.
SETS = {"robot1": ("fuzzy_pid", "0.5"), "left/robot2": ("pid", "0.25")}


def start(children: Children, namespace: str) -> dict[str, Child]:
    """Start the executables that ``trunk plan`` lists."""
    controller, angle = SETS[namespace]
    place = namespace.replace("/", "_")
    plan = said(
        "plan", "demo", "--controller", controller, "--namespace", namespace, "--lockstep",
        "--duration", 2, "--set", f"simulator.initial.position=[0.0, {angle}]",
        "--set", f"recorder.output={place}.mcap", "-o", children.folder / f"{place}.yaml",
    )  # fmt: skip
    started = {}
    for line in plan.splitlines():
        _, _, package, executable, *arguments = shlex.split(line)
        started[executable] = children.fork(
            f"{executable}_{place}", find_executable(package, executable), *arguments
        )
    return started


def test_two_sets_at_once(children: Children, tmp_path: Path) -> None:
    sets = {namespace: start(children, namespace) for namespace in SETS}
    for nodes in sets.values():
        assert nodes["simulator"].wait() == 0, nodes["simulator"].stderr
        for name, node in nodes.items():
            if name != "simulator":
                node.send(signal.SIGINT)
    for nodes in sets.values():
        for node in nodes.values():
            until(lambda node=node: node.process.poll() is not None, f"{node.name} ends")
            assert node.process.returncode == 0, node.stderr
    for namespace, (controller, angle) in SETS.items():
        run = f"{namespace.replace('/', '_')}.mcap"
        verified(tmp_path / run)
        said(
            "simulate", "demo", "--controller", controller, "--duration", 2,
            "--set", f"simulator.initial.position=[0.0, {angle}]", "-o", tmp_path / f"alone_{run}",
        )  # fmt: skip
        said("diff", tmp_path / run, tmp_path / f"alone_{run}")
