"""The files for ros2_control agree with our nodes' declarations."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.pid import PidConfig
from trunk_core import topics
from trunk_core.parameters.declarations import build, declarations
from trunk_core.parameters.parameter_files import read, resolve
from trunk_runs.plan import make_plan
from trunk_sim.config import TrunkSimulator

ROOT = Path(__file__).parents[1]
FILES = ROOT / "examples" / "ros2_control"
URDF = ElementTree.parse(FILES / "trunk.urdf").getroot()
CONTROLLERS = yaml.safe_load((FILES / "controllers.yaml").read_text(encoding="utf-8"))


def configured(name, node, config):
    layer = read(FILES / name)
    values = resolve(f"/robot/{node}", [layer], declarations(config))
    assert set().union(*(s.values for s in layer.sections if s.last_token == node)) == set(values)
    return build(config, values)


def test_the_hardware_is_our_topics_and_the_trunks_joint():
    hardware = URDF.find("ros2_control/hardware")
    parameters = {p.get("name"): p.text for p in hardware.findall("param")}
    assert parameters["joint_states_topic"] == "/" + topics.JOINT_STATES
    assert parameters["joint_commands_topic"] == "/" + topics.EFFORT_COMMAND
    assert float(parameters["trigger_joint_command_threshold"]) < 0.0  # send always
    (joint,) = URDF.findall("ros2_control/joint")
    assert joint.get("name") == TrunkSimulator().joints[1]
    assert [i.get("name") for i in joint.findall("command_interface")] == ["effort"]
    states = [i.get("name") for i in joint.findall("state_interface")]
    assert states == ["position", "velocity", "effort"]
    assert [j.get("name") for j in URDF.findall("joint")] == list(TrunkSimulator().joints)


def test_their_controller_has_our_gains():
    theirs = CONTROLLERS["pid_controller"]["ros__parameters"]
    (joint,) = theirs["dof_names"]
    assert joint == TrunkSimulator().joints[1]
    assert theirs["command_interface"] == "effort"
    ours = make_plan("demo", "pid", ["pid_ziegler_nichols", "profile_practical"]).controller
    gains = theirs["gains"][joint]
    assert (gains["p"], gains["i"], gains["d"]) == (ours.p, ours.i, ours.d)
    assert (gains["u_clamp_max"], gains["u_clamp_min"]) == (ours.u_clamp_max, ours.u_clamp_min)
    assert gains["antiwindup_strategy"] == ours.antiwindup_strategy


def test_the_plant_runs_at_their_rate_and_publishes_the_clock():
    config = configured("simulator.yaml", "simulator", TrunkSimulator)
    rate = CONTROLLERS["controller_manager"]["ros__parameters"]["update_rate"]
    assert config.update_rate == rate
    assert config.publish_clock
    assert not config.lockstep
    assert config.wait_for == (topics.EFFORT_COMMAND,)


@pytest.mark.parametrize(("node", "config"), [("pid", PidConfig), ("fuzzy_pid", FuzzyPidConfig)])
def test_our_controllers_accept_another_robots_joint(node, config):
    found = configured("another_robot.yaml", node, config)
    assert found.joint == "torso_pitch_joint"
    assert 0.0 < found.u_clamp_max < 100.0
    assert -found.u_clamp_min == found.u_clamp_max
