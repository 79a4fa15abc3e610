"""What a node makes of what it hears: once its run is over, from a second node of its name, and malformed.

The tests call the callbacks of nodes in this process.
"""

import itertools
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_msgs_util.node.base import ENDING
from trunk_msgs_util.node.conversions import WireReader, sample_to_wire
from trunk_msgs_util.node.recorder_node import RecorderNode
from trunk_msgs_util.source import process_id
from trunk_recording.schemas import event, parameter_event
from trunk_sim.disturbance_node import DisturbanceNode
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.simulator_node import SimulatorNode
from trunk_sim.step import PlantStatus

from .processes import until

pytestmark = pytest.mark.graph


@pytest.fixture
def simulator(
    arguments: Callable[..., None],
) -> Iterator[Callable[..., tuple[SimulatorNode, list[str]]]]:
    """Yield a function that makes a simulator with parameters, and the list of its events from then on."""
    made = []

    def make(*parameters: str) -> tuple[SimulatorNode, list[str]]:
        arguments(*parameters)
        node, events = SimulatorNode(), list[str]()
        made.append(node)
        node.autostart()
        say = node.event

        def note(message: str, *more: Any, **values: Any) -> None:
            events.append(str(message))
            say(message, *more, **values)

        node.event = note
        return node, events

    yield make
    for node in made:
        node.destroy_node()


@pytest.fixture
def recorder(
    arguments: Callable[..., None], tmp_path: Path
) -> Iterator[Callable[..., RecorderNode]]:
    """Yield a function that makes a recorder with parameters."""
    made = []

    def make(*parameters: str) -> RecorderNode:
        arguments(f"output:={tmp_path / 'run.mcap'}", *parameters)
        made.append(RecorderNode())
        made[-1].autostart()
        return made[-1]

    yield make
    for node in made:
        node.close()


MODES = pytest.mark.parametrize("lockstep", ["true", "false"])


def started(made: tuple[SimulatorNode, list[str]]) -> tuple[SimulatorNode, list[str]]:
    """Let a simulator begin its run."""
    node, events = made
    for name, topic in (("/pid", topics.EFFORT_COMMAND), ("/recorder", "recorder")):
        node._participants.hear(name, "ready", {"answers": topic})
        node._participants._met.add(topic)  # as if it had been matched and had gone
    node._try_start()
    assert events[-1] == "started"
    return made


def command(node: SimulatorNode) -> None:
    sample = JointSample(node.stamp_ns, ("trunk",), effort=(0.0,))
    node._on_command(sample_to_wire(sample))
    node._tick()


@MODES
def test_a_run_that_was_stopped_takes_no_more_steps(simulator: Any, lockstep: str) -> None:
    node, events = started(
        simulator(
            f"lockstep.enabled:={lockstep}",
            "wait_for:=[effort_command]",
            "update_rate:=1000.0",
            "duration:=60.0",
        )
    )
    while node.stamp_ns < 3 * node.period_ns:
        command(node)
    node.stopping()
    stopped_at = node.stamp_ns
    for _ in range(10_000):
        command(node)
    assert node.stamp_ns == stopped_at
    node.stopping()
    assert events.count("stopped") == 1


@MODES
def test_a_simulator_asked_to_end_begins_no_run(simulator: Any, lockstep: str) -> None:
    node, _ = simulator(f"lockstep.enabled:={lockstep}")
    node._participants.missing = lambda now: []
    node.end()
    node._try_start()
    assert (node._running, node.stamp_ns) == (False, 0)
    assert not node._truth_published


@MODES
@pytest.mark.parametrize("end", ["finished", "stopped"])
def test_no_request_after_the_end_changes_the_record(
    simulator: Any, lockstep: str, end: str
) -> None:
    given = (f"lockstep.enabled:={lockstep}", "wait_for:=[effort_command]", "duration:=0.05")
    node, events = started(simulator(*given))
    if end == "finished":
        while node.exit_code is None:
            command(node)
    node.end()
    said = list(events)
    assert said[-1] == end
    reset = node._on_reset(Trigger.Request(), Trigger.Response())
    pause = node._on_pause(SetBool.Request(data=True), SetBool.Response())
    changed = node.set_parameters([Parameter("plant.gravity", value=9.0)])[0]
    asked = Transition(id=Transition.TRANSITION_DEACTIVATE)
    held = node._on_change_state(ChangeState.Request(transition=asked), ChangeState.Response())
    answers = [
        (reset.success, reset.message),
        (pause.success, pause.message),
        (changed.successful, changed.reason),
    ]
    assert answers == [(False, ENDING)] * 3
    assert not held.success
    assert events == said


@MODES
def test_a_run_that_failed_fails_once(simulator: Any, lockstep: str) -> None:
    node, events = started(
        simulator(f"lockstep.enabled:={lockstep}", "wait_for:=[effort_command,recorder]")
    )
    node._simulation.status = PlantStatus(PlantState(0.0, inf, 0.0, 0.0), 0.0, False, False)
    node._on_command(sample_to_wire(JointSample(0, ("trunk",), effort=(1.0,))))
    # In real time twenty steps are due at once.
    node._pacing.tick(time.monotonic_ns() + 20 * node.period_ns)
    for stamp_ns in (0, node.period_ns):
        node._on_progress(sample_to_wire(JointSample(stamp_ns, ("recorder",))))
    assert events.count("failed") == 1
    assert node.exit_code == 1


def test_a_simulator_fails_before_it_is_configured(simulator: Any) -> None:
    node, events = simulator("autostart:=false")
    node.fail("a callback raised")
    assert (events, node.exit_code) == (["failed"], 1)


def test_an_end_without_a_count_of_states_is_malformed(recorder: Any) -> None:
    node = recorder()
    node._on_event(event(0, "/simulator", "finished", {"states": "many"}))
    node._on_event(event(0, "/simulator", "finished"))
    assert node.counters["events malformed"] == 2
    assert not node.verdict()[0]


@pytest.mark.parametrize("torque", [0.0, 3.0])
def test_a_run_is_not_complete_without_the_commands_that_drove_it(
    recorder: Any, torque: float
) -> None:
    lockstep = ("lockstep.enabled:=true", f"lockstep.topics:=[{topics.GROUND_TRUTH}]")
    node = recorder(*lockstep)
    for stamp_ns, effort in ((0, 0.0), (10**6, torque)):
        node._on_truth(
            sample_to_wire(JointSample(stamp_ns, ("hip", "trunk"), effort=(0.0, effort)))
        )
    node._account.counts.update({("", topics.GROUND_TRUTH): 2, ("", topics.JOINT_STATES): 2})
    node._on_event(event(0, "/simulator", "finished", {"states": "2"}))
    complete, why = node.verdict()
    assert complete == (torque == 0.0), why
    assert ("a torque acted on the plant" in why) == (torque != 0.0)


@pytest.mark.parametrize(
    "durability", [DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL]
)
@pytest.mark.parametrize("first", ["copy", "original"])
def test_a_message_and_its_copy_are_recorded_once(
    recorder: Any, first: str, durability: DurabilityPolicy
) -> None:
    """Whichever comes first; who serializes a message anew may leave anything in its padding."""
    heard = (node := recorder())._recorded[topics.DISTURBANCE]
    kind = ReliabilityPolicy.RELIABLE, durability
    info = {"publication_sequence_number": 1, "source_timestamp": 1}
    sample = JointSample(0, ("hip", "trunk"), effort=(0.0, 1.0))
    original = sample_to_wire(sample, f"disturbance@{process_id()}")
    copy = original.replace(b"trunk\0\0\0", b"trunk\0\1\1")
    assert copy != original
    if first == "original":
        heard._on_kept(original, info)
    heard._hear_passing(kind)
    heard._on_passing(copy, info, kind)
    if first == "copy":
        heard._on_kept(original, info)
    assert node._account.count(topics.DISTURBANCE) == 1


def test_no_parameter_of_anybodys_ends_a_recorder(recorder: Any) -> None:
    node = recorder()
    for values in ({"duration": "abc"}, {"duration": 0.5}, {"duration": True}):
        node._on_change(parameter_event(0, "/mine", values, {}, source="mine@boot.1.1"))
    assert node.exit_code is None


def test_a_recorder_that_ends_looks_for_messages_first(
    recorder: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long nothing has come, and however much time a busy machine lets pass between turns."""
    node = recorder()
    passed_s = itertools.count(time.monotonic(), 10.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(passed_s))
    node._on_event(event(0, "/simulator", "finished", {"states": "0"}))
    turns = list(itertools.takewhile(lambda _: node.draining(), range(100)))
    monkeypatch.undo()
    assert 10 <= len(turns) < 100


def disturb(node: SimulatorNode, stamp_ns: int) -> None:
    sample = JointSample(stamp_ns, ("hip", "trunk"), position=(0.0, 0.0), effort=(0.0, 1.0))
    node._on_disturbance(sample_to_wire(sample))


@MODES
def test_no_event_says_how_many_disturbances_were_taken(simulator: Any, lockstep: str) -> None:
    """In real time each row of ``plant/inputs`` names the one in force."""
    given = (f"lockstep.enabled:={lockstep}", "wait_for:=[effort_command]", "duration:=0.0")
    node, events = started(simulator(*given))
    for k in (0, 1, 1, 2):  # one comes twice
        disturb(node, k * node.period_ns)
    node.end()
    assert events[events.index("started") + 1 :] == ["refused", "finished"]


@pytest.mark.parametrize("end", ["finished", "stopped"])
def test_a_disturbance_after_the_end_is_not_counted(simulator: Any, end: str) -> None:
    node, events = started(simulator("wait_for:=[effort_command]", "duration:=0.05"))
    while end == "finished" and node.exit_code is None:
        command(node)
    node.end()
    disturb(node, node.stamp_ns)
    assert events[-1] == end


HALVES = {
    "four efforts": {"effort": (1.0, 2.0, 3.0, 4.0)},
    "four positions": {"position": (1.0, 2.0, 3.0, 4.0)},
    "three efforts, one position": {"effort": (1.0, 2.0, 3.0), "position": (4.0,)},
    "efforts alone": {"effort": (1.0, 2.0)},
}


@pytest.mark.parametrize("values", HALVES.values(), ids=HALVES)
def test_each_field_of_a_disturbance_has_a_value_per_joint(simulator: Any, values: Any) -> None:
    node, _ = simulator("wait_for:=[effort_command]")
    node._on_disturbance(sample_to_wire(JointSample(0, ("hip", "trunk"), **values)))
    assert node.counters == {"disturbances malformed": 1}
    assert not node._disturbances
    whole = JointSample(0, ("hip", "trunk"), position=(3.0, 4.0), effort=(1.0, 2.0))
    node._on_disturbance(sample_to_wire(whole))
    node._disturbances.advance(0, None)
    assert node._disturbances.disturbance == Disturbance(1.0, 2.0, 3.0, 4.0)


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


def hears(node: SimulatorNode, process: str, name: str = "/simulator") -> None:
    node.look_for_duplicate(name, Event.CONFIGURED, {"process": process})


def test_the_older_of_two_processes_goes_on(simulator: Any, younger: str) -> None:
    node, _ = simulator("wait_for:=[effort_command]")
    hears(node, younger)
    hears(node, process_id())
    hears(node, "")
    assert node.exit_code is None


@pytest.mark.parametrize("under_way", [False, True])
def test_the_younger_ends_and_says_so_on_record_only_if_its_run_is_under_way(
    simulator: Any, older: str, under_way: bool
) -> None:
    """Else the older one's recorder would take it for the end of that run."""
    node, events = simulator("wait_for:=[effort_command]")
    hears(node, older, "/robot2/simulator")
    assert node.exit_code is None, "in a namespace of its own it is another one"
    node._running = under_way
    hears(node, older)
    assert node.exit_code == 1
    assert events == (["failed"] if under_way else [])


def test_a_process_that_has_ended_is_nobodys_namesake(simulator: Any) -> None:
    node, _ = simulator("wait_for:=[effort_command]")
    child = subprocess.Popen(["/bin/true"])
    gone = process_id(child.pid)
    child.wait()
    hears(node, gone)
    hears(node, ELSEWHERE)  # of a recording that is being played: the graph shows one node
    assert node.exit_code is None


@pytest.mark.parametrize(
    ("under_way", "configured_s", "stays"),
    [(True, 0.0, True), (False, 10.0, True), (False, 0.0, False)],
    ids=["under way", "settled", "just started"],
)
def test_of_two_machines_the_one_with_a_run_or_the_settled_one_stays(
    simulator: Any, under_way: bool, configured_s: float, stays: bool
) -> None:
    node, _ = simulator("wait_for:=[effort_command]")
    other = Node("simulator")
    own = ("simulator", "/")
    until(lambda: node.get_node_names_and_namespaces().count(own) == 2, "both are in the graph")
    node._running = under_way
    node._configured_s -= configured_s
    hears(node, ELSEWHERE)
    assert (node.exit_code is None) == stays
    other.destroy_node()


def test_what_a_second_node_says_is_not_the_firsts(recorder: Any, younger: str, older: str) -> None:
    node = recorder()

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


def test_a_node_that_takes_anothers_place_is_heard(recorder: Any) -> None:
    node = recorder()
    child = subprocess.Popen(["/bin/true"])
    gone = process_id(child.pid)
    child.wait()
    for process in (gone, process_id()):
        told = {"process": process, "kind": "pid"}
        node._on_event(event(0, "/pid", "configured", told, source=f"pid@{process}"))
        assert not node.is_second("/pid", process)
    assert node.is_second("/pid", "") is False


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
