"""A user's own controller: the commands of docs/controllers.md, word for word, in a scratch folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trunk_experiments.plans.nodes import CONTROLLERS

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

PAGE = Path(__file__).parents[2] / "docs" / "controllers.md"
NAME = "my_controller"


def commands_of(page: Path) -> str:
    """Return the page's shell commands, in order."""
    return "\n".join(
        re.findall(r"^```sh\n(.*?)^```$", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    )


@pytest.mark.long
def test_the_pages_commands_work(children: Children, peer: Peer, tmp_path: Path) -> None:
    assert NAME not in CONTROLLERS
    script = tmp_path / "page.sh"
    script.write_text(f"set -e\n{commands_of(PAGE)}", "utf-8")
    run = children.start("page", "bash", script)
    assert run.wait() == 0, run.stdout + run.stderr
    said = run.stdout
    assert f"({NAME}): 16 of 16 kept" in said
    assert said.count(": verified\n") == 4
    assert "100 runs: 100 ok, 0 diverged, 0 refused" in said
    assert "16 passed" in said
    workspace = tmp_path / "my_ws"
    law = workspace / "src" / NAME / NAME / "law.py"
    assert len(law.read_text("utf-8").splitlines()) <= 40

    in_workspace = f"cd {workspace} && source install/setup.bash && "
    same = in_workspace + "trunk diff lockstep composed; trunk diff lockstep mine.mcap"
    differences = children.start("diff", "bash", "-c", same)
    differences.wait()
    assert differences.stdout.count("identical: 10006 messages, bit for bit\n") == 2

    # By another name than in the page's runs, whose last messages may still arrive.
    alone = f"exec ros2 run {NAME} {NAME} --ros-args -r __node:=alone"
    node = children.start("node", "bash", "-c", in_workspace + alone)
    peer.until_event("alone", "activated")
    assert node.stop() == 0, node.stderr
