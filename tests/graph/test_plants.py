"""Nodes of a plant other than the trunk: their parameters, and plants that are not installed."""

import pytest
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue

from trunk_core import topics
from trunk_msgs_util.node import qos
from trunk_runs.processes import find_executable

from .peer import Peer
from .processes import Children, until
from .services import Services
from .verbs import said

pytestmark = pytest.mark.graph


def test_a_simulators_parameters_are_its_plants(children: Children, peer: Peer) -> None:
    node = children.node("simulator", "plant.name:=cart_pole")
    peer.until_up("simulator")
    services = Services(peer, "simulator")
    name, effort, mass = services.describe("plant.name", "max_effort", "plant.cart_mass")
    assert (name.read_only, effort.description[-3:]) == (True, "[N]")
    assert mass.floating_point_range[0].from_value == 1e-6
    assert services.get("joints", "fall.angle")[0] == ["cart", "pole"]
    assert not services.set(plant__name="trunk").successful
    said("params", "set", "simulator", "plant.length=60cm", "plant.mass=150 g")
    assert services.get("plant.length", "plant.mass") == [0.6, 0.15]
    assert node.stop() == 0
    assert "Traceback" not in node.stderr


def test_a_plant_that_is_not_installed_is_refused(children: Children) -> None:
    node = children.node("simulator", "plant.name:=pendubot")
    assert node.wait() == 2
    assert "'plant.name': 'pendubot' is not allowed: an installed plant (trunk" in node.stderr
    assert "Traceback" not in node.stderr


@pytest.mark.parametrize("executable", ["trunk_experiments markers", "trunk_msgs_util recorder"])
def test_the_markers_of_a_plant_that_is_not_installed_are_one_warning(
    children: Children, peer: Peer, executable: str
) -> None:
    asked = ["--ros-args", "-p", "markers:=true"] if "recorder" in executable else []
    node = children.fork("drawing", find_executable(*executable.split()), *asked)
    start = Parameter(name="initial.position", value=ParameterValue(type=8))  # a simulator's
    name = Parameter(name="plant.name", value=ParameterValue(type=4, string_value="pendubot"))
    told = peer.node.create_publisher(ParameterEvent, topics.RUN_PARAMETERS, qos.run_information())
    told.publish(ParameterEvent(node="/simulator", new_parameters=[name, start]))
    told.publish(ParameterEvent(node="/simulator", changed_parameters=[name]))
    until(lambda: "no picture is drawn" in node.stderr + node.stdout, "a warning")
    node.stop()  # a recorder's file lacks a run
    said_by_it = node.stderr + node.stdout
    assert said_by_it.count("parameter 'plant.name': 'pendubot' is not allowed") == 1
    assert "Traceback" not in said_by_it
