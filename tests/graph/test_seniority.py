"""Which of two nodes of a name goes on, and what its recorder makes of the other's messages.

The tests call the callbacks of nodes in this process.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.node import Node

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.node.conversions import WireReader, sample_to_wire
from trunk_msgs_util.node.recorder_node import RecorderNode
from trunk_msgs_util.recording.schemas import event, parameter_event
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.source import process_id
from trunk_sim.disturbance_node import DisturbanceNode
from trunk_sim.simulator_node import SimulatorNode

from .processes import until

pytestmark = pytest.mark.graph

ELSEWHERE = "another-boot.1.2"


@pytest.fixture
def younger() -> Iterator[str]:
    """A process that was started after this one."""
    child = subprocess.Popen(["/bin/sleep", "3600"])
    yield process_id(child.pid)
    child.kill()
    child.wait()


@pytest.fixture
def older() -> str:
    return process_id(os.getppid())


def simulator(events: list[str]) -> SimulatorNode:
    node = SimulatorNode()
    node.autostart()
    say = node.event

    def note(message: str, *more: Any, **values: Any) -> None:
        events.append(str(message))
        say(message, *more, **values)  # type: ignore[arg-type]

    node.event = note  # type: ignore[method-assign]
    return node


def hears(node: SimulatorNode, process: str, name: str = "/simulator") -> None:
    node.look_for_duplicate(name, Event.CONFIGURED, {"process": process})


def test_the_older_of_two_processes_goes_on(arguments: Any, younger: str) -> None:
    arguments("wait_for:=[effort_command]")
    node = simulator([])
    hears(node, younger)
    hears(node, process_id())
    hears(node, "")
    assert node.exit_code is None
    node.close()


@pytest.mark.parametrize("under_way", [False, True])
def test_the_younger_ends_and_says_so_on_record_only_if_its_run_is_under_way(
    arguments: Any, older: str, under_way: bool
) -> None:
    """Else the older one's recorder would take it for the end of that run."""
    arguments("wait_for:=[effort_command]")
    events: list[str] = []
    node = simulator(events)
    hears(node, older, "/robot2/simulator")
    assert node.exit_code is None, "in a namespace of its own it is another one"
    node._running = under_way
    hears(node, older)
    assert node.exit_code == 1
    assert events == (["failed"] if under_way else [])
    node.close()


def test_a_process_that_has_ended_is_nobodys_namesake(arguments: Any) -> None:
    arguments("wait_for:=[effort_command]")
    node = simulator([])
    child = subprocess.Popen(["/bin/true"])
    gone = process_id(child.pid)
    child.wait()
    hears(node, gone)
    hears(node, ELSEWHERE)  # of a recording that is being played: the graph shows one node
    assert node.exit_code is None
    node.close()


@pytest.mark.parametrize(
    ("under_way", "configured_s", "stays"),
    [(True, 0.0, True), (False, 10.0, True), (False, 0.0, False)],
    ids=["under way", "settled", "just started"],
)
def test_of_two_machines_the_one_with_a_run_or_the_settled_one_stays(
    arguments: Any, under_way: bool, configured_s: float, stays: bool
) -> None:
    arguments("wait_for:=[effort_command]")
    node = simulator([])
    other = Node("simulator")
    own = ("simulator", "/")
    until(lambda: node.get_node_names_and_namespaces().count(own) == 2, "both are in the graph")
    node._running = under_way
    node._configured_s -= configured_s
    hears(node, ELSEWHERE)
    assert (node.exit_code is None) == stays
    other.destroy_node()
    node.close()


def test_what_a_second_node_says_is_not_the_firsts(
    arguments: Any, tmp_path: Path, younger: str, older: str
) -> None:
    arguments(f"output:={tmp_path / 'run.mcap'}")
    node = RecorderNode()
    node.autostart()

    def says(process: str, message: str, /, **values: object) -> None:
        node._on_event(event(0, "/simulator", message, values, source=f"simulator@{process}"))

    says(older, "configured", process=older, kind="simulator")
    says(older, "started", rate=200.0)
    says(younger, "configured", process=younger, kind="simulator")
    says(younger, "started", rate=200.0)
    says(younger, "failed", reason="another /simulator is running", states=1)
    node._on_change(parameter_event(0, "/simulator", {"a": 1.0}, {}, source=f"simulator@{younger}"))
    assert node._account.end is None
    says(older, "finished", states=0, reason="finished")
    assert node.verdict() == (True, "finished")
    node.close()


def test_a_node_that_takes_anothers_place_is_heard(arguments: Any, tmp_path: Path) -> None:
    arguments(f"output:={tmp_path / 'run.mcap'}")
    node = RecorderNode()
    node.autostart()
    child = subprocess.Popen(["/bin/true"])
    gone = process_id(child.pid)
    child.wait()
    for process in (gone, process_id()):
        told = {"process": process, "kind": "pid"}
        node._on_event(event(0, "/pid", "configured", told, source=f"pid@{process}"))
        assert not node.is_second("/pid", process)
    assert node.is_second("/pid", "") is False
    node.close()


def test_the_disturbance_names_its_source_as_the_states_do(arguments: Any) -> None:
    arguments()
    node = DisturbanceNode()
    node.autostart()
    sent: list[bytes] = []
    node._publisher.publish = sent.append  # type: ignore[method-assign]
    read = WireReader()

    def sources_after(stamp_ns: int, frame_id: str) -> set[str]:
        sent.clear()
        node._on_state(sample_to_wire(JointSample(stamp_ns, ("hip", "trunk")), frame_id))
        return {read.frame_id for data in sent if read(data)}

    period_ns = node.config.period_ns
    own = f"disturbance@{process_id()}"
    assert node.source == ""
    assert sources_after(0, "simulator@boot.1.2") == {own}
    assert sources_after(period_ns, "") == {own}, "a stranger's state changes nothing"
    assert sources_after(0, "") == {""}, "another run, in lock-step"
    assert sources_after(period_ns, "") == {""}
    assert sources_after(0, "simulator@boot.3.4") == {own}
    node.close()


def test_nodes_know_by_their_parameters_that_they_are_in_real_time(
    arguments: Any, tmp_path: Path
) -> None:
    arguments(f"output:={tmp_path / 'run.mcap'}")
    for kind, name in ((RecorderNode, "recorder"), (SimulatorNode, "simulator")):
        node = kind()
        assert node.source == f"{name}@{process_id()}"
        node.close()
    rclpy.try_shutdown()
    arguments("lockstep.enabled:=true", f"output:={tmp_path / 'run.mcap'}")
    for kind in (RecorderNode, SimulatorNode):
        node = kind()
        assert node.source == ""
        node.close()
    assert topics.PLANT_INPUTS not in topics.evidence_types((), "lockstep")
    assert topics.PLANT_INPUTS not in topics.evidence_types(("pid",))
    assert topics.PLANT_INPUTS in topics.evidence_types((), "real_time")
