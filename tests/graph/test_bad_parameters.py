"""A wrong parameter ends a node at start: code 2, one line with name, value and what is allowed."""

from pathlib import Path

import pytest

from trunk_runs.nodes import NODES
from trunk_runs.plan import make_plan
from trunk_runs.processes import find_executable

from ..refusals import REFUSALS, Refusal
from .peer import Peer
from .processes import Child, Children, until

pytestmark = pytest.mark.graph

ONLY_TRUNK = "only trunk reads files: give the node the parameter file that trunk plan writes"
ENDING = "the file's name must end in .mcap, such as run"
AT_START = [
    *(one for one in REFUSALS if "no such" not in one.allowed),  # those: NOT_USED
    # What other doors take.
    Refusal("disturbance", {"table.file": "push.csv"}, ONLY_TRUNK),
    Refusal("pid", {"reference.file": "ref.csv"}, ONLY_TRUNK),
    Refusal("recorder", {"output": "/nowhere/run.mcap"}, "a file to write ("),
    Refusal("recorder", {"output": "run.bag"}, f"{ENDING}.bag/run.mcap"),
    Refusal("recorder", {"output": "."}, f"{ENDING}.mcap"),
]
SHARES = 16


def refusal(child: Child) -> str:
    """Return the one line with which a node refuses to start."""
    code = child.wait()
    assert code == 2, f"exit code {code}: {child.stderr}"
    assert child.stdout == ""
    lines = child.stderr.splitlines()
    assert len(lines) == 1, child.stderr
    assert lines[0].startswith(child.name.split("-")[0])
    return lines[0]


@pytest.mark.virtual
@pytest.mark.parametrize("share", range(SHARES))
def test_a_wrong_value(children: Children, share: int) -> None:
    started = {}
    for i, wrong in enumerate(AT_START[share::SHARES]):
        given = [setting.replace("=", ":=", 1) for setting in wrong.settings]
        # Each in its namespace: a second node of a name would be refused for that.
        place = "-r", f"__ns:=/n{i}"
        started[i] = wrong, children.node(wrong.node, *given, *place, name=f"{wrong.node}-{i}")
    for wrong, child in started.values():
        wrong.check(refusal(child))


def test_wrong_arguments(children: Children, tmp_path: Path) -> None:
    no_yaml = tmp_path / "no.yaml"
    no_yaml.write_text("pid: [\n")
    wrong: dict[str, list[object]] = {
        "absent.yaml": ["--params-file", "absent.yaml"],
        "no.yaml": ["--params-file", no_yaml],
        "gains.p": ["-p", "gains.p"],
        "deafening": ["--log-level", "deafening"],
        "--no-such": ["--no-such"],
    }
    started = {
        text: children.node("pid", *arguments, name=f"pid-{i}")
        for i, (text, arguments) in enumerate(wrong.items())
    }
    for text, child in started.items():
        line = refusal(child)
        assert line.startswith("pid: error: "), line
        assert text in line, line


def test_a_plan_for_another_controller(children: Children, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    make_plan("fig8", "fuzzy_pid").write_parameters(file)
    line = refusal(children.node("pid", "--params-file", file))
    assert line.startswith(f"pid: error: {file}: the plan is for fuzzy_pid, it has no /pid: ")
    away = children.node("fuzzy_pid", "--params-file", file, "-r", "__ns:=/away")
    assert "it has no /away/fuzzy_pid" in refusal(away)


ROS = "arguments for ROS 2 follow --ros-args: --ros-args"
NOT_USED = {  # arguments: what nothing uses, and why
    "-p gains.p:=70.0": f"-p gains.p:=70.0: {ROS} -p gains.p:=70.0",
    "gains.p:=70.0 --ros-args -p gains.i:=1.0": (
        f"gains.p:=70.0: {ROS} gains.p:=70.0 -p gains.i:=1.0"
    ),
    "-r __ns:=/a": f"-r __ns:=/a: {ROS} -r __ns:=/a",
    "extra": "extra: leave it out",
    "--ros-args -p gain.p:=70.0": ("-p gain.p:=70.0: no such parameter; did you mean 'gains.p'?"),
    "--ros-args --param zzz:=1": "-p zzz:=1: no such parameter; trunk params lists them all",
    "--ros-args -p lqr:gains.p:=1.0": "-p lqr:gains.p:=1.0: it is for lqr, this is pid",
}


@pytest.mark.virtual
@pytest.mark.parametrize("arguments", NOT_USED)
def test_an_argument_that_nothing_uses(children: Children, arguments: str) -> None:
    node = children.fork("pid", find_executable("trunk_control", "pid"), *arguments.split())
    assert node.wait() == 2
    assert node.stderr.splitlines()[-1] == f"pid: error: nothing uses {NOT_USED[arguments]}"


@pytest.mark.parametrize(
    "package",
    [
        "trunk_control reference",
        "trunk_sim simulator",
        "trunk_sim disturbance",
        "trunk_msgs_util recorder",
        "trunk_experiments markers",
    ],
)
def test_every_executable_refuses_what_it_does_not_use_and_has_help(
    children: Children, package: str
) -> None:
    path = find_executable(*package.split())
    wrong = children.fork(package.split()[1], path, "-p", "nothing:=1")
    shown = children.fork("help", path, "--help")
    assert "arguments for ROS 2 follow --ros-args" in refusal(wrong)
    assert (shown.wait(), shown.stderr) == (0, "")
    assert shown.stdout.startswith(f"usage: {package.split()[1]} --ros-args [-p NAME:=VALUE]")


def test_integer_is_accepted_as_a_double(children: Children, peer: Peer) -> None:
    node = children.node("pid", "gains.p:=60", "u_clamp_max:=50")
    values = peer.until_up("pid")
    assert repr(values["gains.p"]) == "60.0"
    assert repr(values["u_clamp_max"]) == "50.0"
    assert node.stop() == 0
    assert all("[INFO]" in line for line in node.stderr.splitlines()), node.stderr


@pytest.mark.virtual
def test_an_existing_recording_is_replaced_only_when_asked(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    file = tmp_path / "run.mcap"
    file.write_bytes(b"mine")
    line = refusal(children.node("recorder", "output:=run.mcap"))
    assert line == (
        "recorder: error: parameter 'output': 'run.mcap' is not allowed: it exists: "
        "give another name, or -p overwrite:=true to replace it"
    )
    assert file.read_bytes() == b"mine"
    again = children.node("recorder", "output:=run.mcap", "overwrite:=true", name="again")
    until(lambda: file.read_bytes() != b"mine", "the file is replaced")
    assert again.stop() == 1, again.stderr  # of no run at all
    assert file.read_bytes() != b"mine"


@pytest.mark.parametrize("executable", ["pid", "simulator", "recorder"])
def test_a_node_outlives_warnings_that_are_errors(children: Children, executable: str) -> None:
    """Libraries of ROS 2 warn as they are imported."""
    path = find_executable(NODES[executable].package, executable)
    node = children.start(executable, "env", "PYTHONWARNINGS=error", path)
    until(lambda: "waiting for " in node.stderr + node.stdout, f"{executable} runs")
    assert node.stop() == int(executable == "recorder"), node.stderr  # of no run at all
    assert "Traceback" not in node.stderr
