"""``trunk params``: a file, or some values, set in a running node, all or none, and what mistakes lead to."""

import re
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from ..refusals import REFUSALS, Refusal
from .peer import Peer
from .processes import PATIENT, Children
from .services import Services

pytestmark = pytest.mark.graph

Verb = Callable[..., tuple[int, list[str], list[str]]]


@pytest.fixture
def params(children: Children) -> Verb:
    """Return a function that runs ``trunk params``: exit code, lines on stdout, lines on stderr."""
    numbers = count()

    def run(verb: str, *arguments: object) -> tuple[int, list[str], list[str]]:
        # Of two limits the last counts.
        name = f"{verb}-{next(numbers)}"
        child = children.trunk("params", verb, *PATIENT, *arguments, name=name)
        code = child.wait()
        assert "Traceback" not in child.stderr
        return code, child.stdout.splitlines(), child.stderr.splitlines()

    return run


def line_without(params: Verb, verb: str, node: str, *arguments: object) -> str:
    """Return the line about a node that is not there, where others are.

    It may find no node at all if one was held up for as long as it waits: then it waits twice as long.
    """
    limit_s = 3
    while True:
        code, said, (line,) = params(verb, node, *arguments, "--timeout", limit_s)
        assert (code, said) == (1, [])
        assert f"within {limit_s} s" in line
        if "none in this ROS domain" not in line:
            return line
        limit_s *= 2


def test_a_file_is_applied_as_a_whole(
    children: Children, peer: Peer, params: Verb, tmp_path: Path
) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    file = tmp_path / "mine.yaml"
    file.write_text("pid:\n  ros__parameters:\n    gains: {p: 70, d: 9.0}\n    u_clamp_max: .inf\n")
    wanted = ["u_clamp_max: 100.0 -> .inf", "gains.p: 60.0 -> 70.0"]

    code, said, _ = params("apply", "pid", file, "--dry-run")
    assert (code, sorted(said)) == (0, sorted(wanted))
    assert Services(peer, "pid").get("gains.p") == [60.0]
    code, said, _ = params("apply", "pid", file)
    assert (code, sorted(said)) == (0, sorted(wanted))
    assert Services(peer, "pid").get("gains.p", "u_clamp_max") == [70.0, float("inf")]
    assert params("apply", "/pid", file)[:2] == (0, ["nothing to change"])
    changed = [p.changed for p in peer.parameters if p.changed]
    assert changed == [{"gains.p": 70.0, "u_clamp_max": float("inf")}]

    # A shipped file, by name: its node section has a wildcard namespace.
    assert params("apply", "pid", "pid_as_printed")[0] == 0
    assert Services(peer, "pid").get("gains.p", "gains.i", "gains.d") == [60.0, 36.0, 400.0]

    # Linked values are refused as a set, in the node's words.
    file.write_text("/**:\n  ros__parameters: {gains.p: 1.0, u_clamp_max: -200.0, not.ours: 3}\n")
    code, said, (line,) = params("apply", "pid", file)
    assert (code, said) == (1, [])
    assert line == (
        "trunk: error: /pid refuses: parameter 'u_clamp_max': -200.0 is not allowed: "
        "it must be greater than u_clamp_min (-100)"
    )
    # The file may contain fixed parameters, but not with other values.
    file.write_text("pid:\n  ros__parameters: {gains.p: 1.0, update_rate: 200, joint: hip}\n")
    code, said, (line,) = params("apply", "pid", file)
    assert (code, said) == (1, [])
    assert "/pid: joint: trunk -> hip (fixed at start): nothing is changed" in line
    assert Services(peer, "pid").get("gains.p", "u_clamp_max") == [60.0, float("inf")]
    file.write_text("pid:\n  ros__parameters: {gains.p: 1.0, update_rate: 200}\n")
    assert params("apply", "pid", file)[:2] == (0, ["gains.p: 60.0 -> 1.0"])
    assert pid.stop() == 0, pid.stderr


def test_rule_tables_in_a_namespace(
    children: Children, peer: Peer, params: Verb, tmp_path: Path
) -> None:
    node = children.node("fuzzy_pid", "-r", "__ns:=/robot2")
    peer.hear_run("/robot2")
    peer.until_up("/robot2/fuzzy_pid")
    code, said, _ = params("apply", "robot2/fuzzy_pid", "fuzzy_zhao_1993")
    assert code == 0
    (kp, kd) = said  # alpha's table is the same
    assert kp.startswith("rules.kp: [B B B B B B B, S S B B B S S, ")
    assert "-> [S S S S S S S, B B S S S B B, " in kd
    assert params("apply", "robot2/fuzzy_pid", "fuzzy_zhao_1993")[1] == ["nothing to change"]
    # One cell, by a file and by ROS 2's own service.
    file = tmp_path / "cell.yaml"
    file.write_text("/**:\n  ros__parameters: {rules: {kd: {NB: {PB: 0.5}}}}\n")
    assert params("apply", "fuzzy_pid", file, "--namespace", "robot2")[0] == 0
    result = Services(peer, "robot2/fuzzy_pid").set(rules__kd__NB__NB="B")
    assert result.successful, result.reason
    ((first, *_),) = Services(peer, "robot2/fuzzy_pid").get("rules.kd")
    assert first == "B S S S S S 0.5"
    assert node.stop() == 0, node.stderr


def test_mistakes_are_reported_in_one_line(
    children: Children, peer: Peer, params: Verb, tmp_path: Path
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
        found, said, (line,) = params("apply", *arguments)
        assert (found, said) == (code, []), line
        for text in texts:
            assert text in line
    line = line_without(params, "apply", "pid", "pid_as_printed")
    assert "no node /pid within " in line
    assert "/spare" in line
    assert node.stop() == 0, node.stderr


def test_numbers_with_units_are_set_in_si(
    children: Children, peer: Peer, params: Verb, tmp_path: Path
) -> None:
    node = children.node("disturbance", "pulse.channel:=hip_effort")
    peer.until_up("disturbance")
    file = tmp_path / "mine.yaml"
    file.write_text(
        "disturbance:\n  ros__parameters: {pulse: {magnitude: 50 N, duration: 50 ms}}\n"
    )
    assert params("apply", "disturbance", file)[0] == 0
    assert Services(peer, "disturbance").get("pulse.magnitude", "pulse.duration") == [50.0, 0.05]
    # The node's own channel chooses the unit.
    file.write_text(
        "disturbance:\n  ros__parameters: {pulse.magnitude: 5 deg, pulse.duration: 0.1}\n"
    )
    code, said, (line,) = params("apply", "disturbance", file)
    assert (code, said) == (2, [])
    assert (
        "/disturbance: parameter 'pulse.magnitude': '5 deg' is not allowed: it is an angle" in line
    )
    # By itself the node knows no units.
    result = Services(peer, "disturbance").set(pulse__duration="50 ms")
    assert not result.successful
    assert result.reason.endswith("only trunk reads units: give a plain number in s")
    assert Services(peer, "disturbance").get("pulse.duration") == [0.05]
    assert node.stop() == 0, node.stderr


def test_values_are_set_in_one_transaction(children: Children, peer: Peer, params: Verb) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    gains = ("gains.p=70", "gains.d=9.5", "u_clamp_max=inf")
    wanted = ["gains.p: 60.0 -> 70.0", "gains.d: 9.0 -> 9.5", "u_clamp_max: 100.0 -> .inf"]

    assert params("set", "pid", *gains, "--dry-run")[:2] == (0, wanted)
    assert Services(peer, "pid").get("gains.p") == [60.0]
    assert params("set", "pid", *gains) == (0, wanted, [])
    assert Services(peer, "pid").get("gains.p", "gains.d", "u_clamp_max") == [
        70.0,
        9.5,
        float("inf"),
    ]
    assert params("set", "/pid", *gains)[:2] == (0, ["nothing to change"])
    changed = [p.changed for p in peer.parameters if p.changed]
    assert changed == [{"gains.p": 70.0, "gains.d": 9.5, "u_clamp_max": float("inf")}]

    # All or none, in the node's words.
    code, said, (line,) = params("set", "pid", "gains.d=8", "gains.p=-1")
    assert (code, said) == (1, [])
    assert line.startswith("trunk: error: /pid refuses: parameter 'gains.p': -1.0 is not allowed")
    assert Services(peer, "pid").get("gains.d") == [9.5]
    assert pid.stop() == 0, pid.stderr


@pytest.mark.one_in(40)
@pytest.mark.parametrize(
    "refusal",
    [one for one in REFUSALS if " is no " not in one.allowed],  # trunk finds cells itself
    ids=str,
)
def test_what_a_node_refuses(
    children: Children, peer: Peer, params: Verb, refusal: Refusal
) -> None:
    node = children.node(refusal.node)
    peer.until_up(refusal.node)
    code, said, (line,) = params("set", refusal.node, *refusal.settings)
    assert (code, said) == (1, [])
    assert line.startswith(f"trunk: error: /{refusal.node}")
    refusal.running.check(line)
    assert node.stop() == int(refusal.node == "recorder")  # of no run at all


def test_a_node_in_a_namespace_and_none(children: Children, peer: Peer, params: Verb) -> None:
    node = children.node("pid", "-r", "__ns:=/robot2")
    peer.hear_run("/robot2")
    peer.until_up("/robot2/pid")
    assert params("set", "pid", "gains.p=61", "--namespace", "robot2")[0] == 0
    assert params("set", "robot2/pid", "gains.p=62")[1] == ["gains.p: 61.0 -> 62.0"]
    line = line_without(params, "set", "pdi", "gains.p=1", "--namespace", "robot2")
    assert re.match(r"trunk: error: no node /robot2/pdi within \d+ s; running", line)
    assert "did you mean '/robot2/pid'?" in line
    code, _, (line,) = params("set", "/robot2/pid", "gains.p=1", "--namespace", "robot2")
    assert (code, "give pid" in line) == (2, True)
    assert node.stop() == 0, node.stderr


def test_a_running_node_gets_the_numbers_of_a_csv_file(
    children: Children, peer: Peer, params: Verb, tmp_path: Path
) -> None:
    (tmp_path / "ref.csv").write_text("t [ms],reference\n0,0.5\n100,0.25\n")
    (tmp_path / "mine.yaml").write_text(
        "pid:\n  ros__parameters:\n    reference: {profile: sequence, file: ref.csv}\n"
    )
    pid = children.node("pid")
    peer.until_up("pid")
    names = ("reference.profile", "reference.times", "reference.values")
    numbers = [[0.0, 0.1], [0.5, 0.25]]
    said = params("set", "pid", "reference.profile=interpolated", "reference.file=ref.csv")
    assert said[::2] == (0, [])
    found = Services(peer, "pid").get(*names)
    assert [found[0], *map(list, found[1:])] == ["interpolated", *numbers]
    assert params("apply", "pid", "mine.yaml")[:2] == (
        0,
        ["reference.profile: interpolated -> sequence"],
    )
    code, said, (line,) = params(
        "set", "pid", "reference.file=none.csv", "reference.profile=interpolated"
    )
    assert (code, said) == (2, [])
    assert "reference.file: none.csv: no such file" in line
    assert "only trunk reads files" in Services(peer, "pid").set(reference__file="ref.csv").reason
    assert pid.stop() == 0, pid.stderr
