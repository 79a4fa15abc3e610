"""A callback that raises, a defect: the process ends with code 1, and what was recorded is kept."""

from pathlib import Path

import pytest

from trunk_recording.reader import Recording

from .processes import Children
from .recordings import finished_file

pytestmark = pytest.mark.graph

# A composed process: the nodes of a run, one of which raises in one of its callbacks.
COMPOSED = """
import sys
from functools import partial
from trunk_control.controller_node import ControllerNode
from trunk_control.laws import law_named
from trunk_msgs_util.node.recorder_node import RecorderNode
from trunk_msgs_util.node.execution import run_nodes
from trunk_sim.simulator_node import SimulatorNode

def raising(node_class, method, after):
    calls = 0
    def broken(self, *arguments):
        nonlocal calls
        calls += 1
        if calls > after:
            raise ZeroDivisionError("a defect")
        return getattr(node_class, method)(self, *arguments)
    return type(node_class.__name__, (node_class,), {method: broken})

name, method, after = sys.argv[1], sys.argv[2], int(sys.argv[3])
sys.argv[1:4] = []
classes = {"recorder": RecorderNode, "pid": ControllerNode, "simulator": SimulatorNode}
classes[name] = raising(classes[name], method, after)
classes["pid"] = partial(classes["pid"], law_named("pid"))
sys.exit(run_nodes(classes, "composed"))
"""


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("node", "method", "after"),
    [
        ("pid", "_on_reading", 300),
        ("simulator", "_on_command", 300),
        ("recorder", "_on_truth", 300),
        ("simulator", "set_up", 0),
        ("pid", "__init__", 0),
    ],
)
def test_the_recording_is_finished(
    children: Children, tmp_path: Path, node: str, method: str, after: int
) -> None:
    parameters = ["duration:=0.0", "lockstep.enabled:=true", "output:=run.mcap"]
    parameters += ["controllers:=[pid]", "wait_for:=[effort_command]"]
    given = [word for parameter in parameters for word in ("-p", parameter)]
    child = children.python(COMPOSED, node, method, after, "--ros-args", *given)
    assert child.wait() == 1, child.stderr
    assert "ZeroDivisionError: a defect" in child.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.end is not None
    assert not recording.complete
    if after:
        assert finished_file(tmp_path / "run.mcap")["/joint_states"] > 200
        assert recording.end["reason"] == "a callback raised ZeroDivisionError: a defect"
