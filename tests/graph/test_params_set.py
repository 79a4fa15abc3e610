"""``trunk params set``: some values in a running node, all or none, and what it says of mistakes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from .params import Verb, line_without, params, values
from .peer import Peer
from .processes import PATIENT, Children

pytestmark = pytest.mark.graph


@pytest.fixture
def set_values(children: Children) -> Verb:
    return params(children, "set")


def test_values_are_set_in_one_transaction(
    children: Children, peer: Peer, set_values: Verb
) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    gains = ("gains.p=70", "gains.d=9.5", "u_clamp_max=inf")
    wanted = ["gains.p: 60.0 -> 70.0", "gains.d: 9.0 -> 9.5", "u_clamp_max: 100.0 -> .inf"]

    assert set_values("pid", *gains, "--dry-run")[:2] == (0, wanted)
    assert values(peer, "/pid", "gains.p") == [60.0]
    assert set_values("pid", *gains) == (0, wanted, [])
    assert values(peer, "/pid", "gains.p", "gains.d", "u_clamp_max") == [70.0, 9.5, float("inf")]
    assert set_values("/pid", *gains)[:2] == (0, ["nothing to change"])
    changed = [p.changed for p in peer.parameters if p.changed]
    assert changed == [{"gains.p": 70.0, "gains.d": 9.5, "u_clamp_max": float("inf")}]

    # All or none, in the node's words.
    for settings, reason in (
        (
            ("gains.d=8", "gains.p=-1"),
            "parameter 'gains.p': -1.0 is not allowed: double, >= 0 and <= 1e+09",
        ),
        (
            ("gains.d=8", "u_clamp_max=-200"),
            "'u_clamp_max': -200.0 is not allowed: it must be greater than",
        ),
        (("gains.d=8", "update_rate=300"), "'update_rate': 300.0 is not allowed: fixed at start"),
        (("gains.d=8", "joint=3"), "parameter 'joint': 3 is not allowed: "),
    ):
        code, said, (line,) = set_values("pid", *settings)
        assert (code, said) == (1, [])
        assert line.startswith("trunk: error: /pid refuses: ")
        assert reason in line
    code, said, (line,) = set_values("pid", "gains.d=8", "gain.p=1")
    assert (code, said) == (1, [])
    assert line == (
        "trunk: error: /pid: parameter 'gain.p': no such parameter; did you mean 'gains.p'?"
    )
    assert values(peer, "/pid", "gains.d") == [9.5]
    assert pid.stop() == 0, pid.stderr


def test_a_node_in_a_namespace_and_none(children: Children, peer: Peer, set_values: Verb) -> None:
    node = children.node("pid", "-r", "__ns:=/robot2")
    peer.hear_run("/robot2")
    peer.until_up("/robot2/pid")
    assert set_values("pid", "gains.p=61", "--namespace", "robot2")[0] == 0
    assert set_values("robot2/pid", "gains.p=62")[1] == ["gains.p: 61.0 -> 62.0"]
    line = line_without(set_values, "pdi", "gains.p=1", "--namespace", "robot2")
    assert re.match(r"trunk: error: no node /robot2/pdi within \d+ s; running", line)
    assert "did you mean '/robot2/pid'?" in line
    code, _, (line,) = set_values("/robot2/pid", "gains.p=1", "--namespace", "robot2")
    assert (code, "give pid" in line) == (2, True)
    assert node.stop() == 0, node.stderr


def test_a_running_node_gets_the_numbers_of_a_csv_file(
    children: Children, peer: Peer, set_values: Verb, tmp_path: Path
) -> None:
    (tmp_path / "ref.csv").write_text("t [ms],reference\n0,0.5\n100,0.25\n")
    (tmp_path / "mine.yaml").write_text(
        "pid:\n  ros__parameters:\n"
        "    reference: {profile: file, file: ref.csv, interpolation: hold}\n"
    )
    pid = children.node("pid")
    peer.until_up("pid")
    names = ("reference.profile", "reference.times", "reference.values")
    numbers = [[0.0, 0.1], [0.5, 0.25]]
    said = set_values("pid", "reference.profile=file", "reference.file=ref.csv")
    assert said[::2] == (0, [])
    found = values(peer, "/pid", *names)
    assert [found[0], *map(list, found[1:])] == ["interpolated", *numbers]
    apply = children.trunk("params", "apply", *PATIENT, "pid", "mine.yaml", name="apply")
    assert (apply.wait(), apply.stdout) == (0, "reference.profile: interpolated -> sequence\n")
    code, said, (line,) = set_values("pid", "reference.file=none.csv", "reference.profile=file")
    assert (code, said) == (2, [])
    assert "reference.file: none.csv: no such file" in line
    asked = [Parameter("reference.file", value="ref.csv").to_parameter_msg()]
    answer = peer.call(SetParameters, "/pid/set_parameters", parameters=asked)
    assert "only trunk reads files" in answer.results[0].reason
    assert pid.stop() == 0, pid.stderr
