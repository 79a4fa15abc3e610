"""``trunk params apply``: a parameter file set in a running node, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from .params import Verb, line_without, params, values
from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph


@pytest.fixture
def apply(children: Children) -> Verb:
    return params(children, "apply")


def test_a_file_is_applied_as_a_whole(
    children: Children, peer: Peer, apply: Verb, tmp_path: Path
) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    file = tmp_path / "mine.yaml"
    file.write_text("pid:\n  ros__parameters:\n    gains: {p: 70, d: 9.0}\n    u_clamp_max: .inf\n")
    wanted = ["u_clamp_max: 100.0 -> .inf", "gains.p: 60.0 -> 70.0"]

    code, said, _ = apply("pid", file, "--dry-run")
    assert (code, sorted(said)) == (0, sorted(wanted))
    assert values(peer, "pid", "gains.p") == [60.0]
    code, said, _ = apply("pid", file)
    assert (code, sorted(said)) == (0, sorted(wanted))
    assert values(peer, "pid", "gains.p", "u_clamp_max") == [70.0, float("inf")]
    assert apply("/pid", file)[:2] == (0, ["nothing to change"])
    changed = [p.changed for p in peer.parameters if p.changed]
    assert changed == [{"gains.p": 70.0, "u_clamp_max": float("inf")}]

    # A shipped file, by name: its node section has a wildcard namespace.
    assert apply("pid", "pid_as_printed")[0] == 0
    assert values(peer, "pid", "gains.p", "gains.i", "gains.d") == [60.0, 36.0, 400.0]

    # Linked values are refused as a set, in the node's words.
    file.write_text("/**:\n  ros__parameters: {gains.p: 1.0, u_clamp_max: -200.0, not.ours: 3}\n")
    code, said, (line,) = apply("pid", file)
    assert (code, said) == (1, [])
    assert line == (
        "trunk: error: /pid refuses: parameter 'u_clamp_max': -200.0 is not allowed: "
        "it must be greater than u_clamp_min (-100)"
    )
    # The file may contain fixed parameters, but not with other values.
    file.write_text("pid:\n  ros__parameters: {gains.p: 1.0, update_rate: 200, joint: hip}\n")
    code, said, (line,) = apply("pid", file)
    assert (code, said) == (1, [])
    assert "/pid: joint: trunk -> hip (fixed at start): nothing is changed" in line
    assert values(peer, "pid", "gains.p", "u_clamp_max") == [60.0, float("inf")]
    file.write_text("pid:\n  ros__parameters: {gains.p: 1.0, update_rate: 200}\n")
    assert apply("pid", file)[:2] == (0, ["gains.p: 60.0 -> 1.0"])
    assert pid.stop() == 0, pid.stderr


def test_rule_tables_in_a_namespace(
    children: Children, peer: Peer, apply: Verb, tmp_path: Path
) -> None:
    node = children.node("fuzzy_pid", "-r", "__ns:=/robot2")
    peer.hear_run("/robot2")
    peer.until_up("/robot2/fuzzy_pid")
    code, said, _ = apply("robot2/fuzzy_pid", "fuzzy_zhao_1993")
    assert code == 0
    (kp, kd) = said  # alpha's table is the same
    assert kp.startswith("rules.kp: [B B B B B B B, S S B B B S S, ")
    assert "-> [S S S S S S S, B B S S S B B, " in kd
    assert apply("robot2/fuzzy_pid", "fuzzy_zhao_1993")[1] == ["nothing to change"]
    # One cell, by a file and by ROS 2's own service.
    file = tmp_path / "cell.yaml"
    file.write_text("/**:\n  ros__parameters: {rules: {kd: {NB: {PB: 0.5}}}}\n")
    assert apply("fuzzy_pid", file, "--namespace", "robot2")[0] == 0
    sent = Parameter("rules.kd.NB.NB", value="B").to_parameter_msg()
    service = "/robot2/fuzzy_pid/set_parameters"
    (result,) = peer.call(SetParameters, service, parameters=[sent]).results
    assert result.successful, result.reason
    ((first, *_),) = values(peer, "robot2/fuzzy_pid", "rules.kd")
    assert first == "B S S S S S 0.5"
    assert node.stop() == 0, node.stderr


def test_mistakes_are_reported_in_one_line(
    children: Children, peer: Peer, apply: Verb, tmp_path: Path
) -> None:
    node = children.node("pid", "-r", "__node:=spare")
    peer.until_up("spare")
    misspelt, mixed = tmp_path / "misspelt.yaml", tmp_path / "mixed.yaml"
    misspelt.write_text("spare:\n  ros__parameters:\n    gain.p: 1.0\n")
    mixed.write_text("spare:\n  ros__parameters:\n    reference.times: [1.0, two]\n")
    for arguments, code, texts in (
        (("spare", "pid_as_printed"), 2, ("pid_as_printed.yaml: nothing for /spare in it",)),
        (("spare", "absent.yaml"), 2, ("no parameter file 'absent.yaml'",)),
        (("spare", misspelt), 2, ("misspelt.yaml: spare: ", "did you mean 'gains.p'?")),
        (("spare", mixed), 1, ("'reference.times': [1.0, 'two'] cannot be the value",)),
    ):
        found, said, (line,) = apply(*arguments)
        assert (found, said) == (code, []), line
        for text in texts:
            assert text in line
    line = line_without(apply, "pid", "pid_as_printed")
    assert "no node /pid within " in line
    assert "/spare" in line
    assert node.stop() == 0, node.stderr


def test_numbers_with_units_are_set_in_si(
    children: Children, peer: Peer, apply: Verb, tmp_path: Path
) -> None:
    node = children.node("disturbance", "pulse.channel:=hip_effort")
    peer.until_up("disturbance")
    file = tmp_path / "mine.yaml"
    file.write_text(
        "disturbance:\n  ros__parameters: {pulse: {magnitude: 50 N, duration: 50 ms}}\n"
    )
    assert apply("disturbance", file)[0] == 0
    assert values(peer, "disturbance", "pulse.magnitude", "pulse.duration") == [50.0, 0.05]
    # The node's own channel chooses the unit.
    file.write_text(
        "disturbance:\n  ros__parameters: {pulse.magnitude: 5 deg, pulse.duration: 0.1}\n"
    )
    code, said, (line,) = apply("disturbance", file)
    assert (code, said) == (2, [])
    assert (
        "/disturbance: parameter 'pulse.magnitude': '5 deg' is not allowed: it is an angle" in line
    )
    # By itself the node knows no units.
    sent = Parameter("pulse.duration", value="50 ms").to_parameter_msg()
    (result,) = peer.call(SetParameters, "/disturbance/set_parameters", parameters=[sent]).results
    assert not result.successful
    assert result.reason.endswith("only trunk reads units: give a plain number in s")
    assert values(peer, "disturbance", "pulse.duration") == [0.05]
    assert node.stop() == 0, node.stderr
