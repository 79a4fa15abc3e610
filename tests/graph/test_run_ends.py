"""A run that is over stays over, whatever its node still hears.

The tests call the callbacks of nodes in this process.
"""

from __future__ import annotations

import itertools
import time
from math import inf
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import sample_to_wire
from trunk_msgs_util.node.managed import ENDING
from trunk_msgs_util.node.recorder_node import RecorderNode
from trunk_msgs_util.recording.schemas import event, parameter_event
from trunk_msgs_util.samples import JointSample
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.simulator_node import SimulatorNode
from trunk_sim.step import PlantStatus

pytestmark = pytest.mark.graph

MODES = pytest.mark.parametrize("lockstep", ["true", "false"])


def started(events: list[str]) -> SimulatorNode:
    """Return a simulator that has begun, whose events are noted."""
    node = SimulatorNode()
    say = node.event

    def note(message: str, *more: Any, **values: Any) -> None:
        events.append(message)
        say(message, *more, **values)

    node.event = note
    node.autostart()
    for name, topic in (("/pid", topics.EFFORT_COMMAND), ("/recorder", "recorder")):
        node._participants.hear(name, "ready", {"answers": topic})
        node._participants._met.add(topic)  # as if it had been matched and had gone
    node._try_start()
    assert events[-1] == "started"
    return node


def command(node: SimulatorNode) -> None:
    sample = JointSample(node.stamp_ns, ("trunk",), effort=(0.0,))
    node._on_command(sample_to_wire(sample))
    node._tick()


@MODES
def test_a_run_that_was_stopped_takes_no_more_steps(arguments: Any, lockstep: str) -> None:
    arguments(
        f"lockstep.enabled:={lockstep}",
        "wait_for:=[effort_command]",
        "update_rate:=1000.0",
        "duration:=60.0",
    )
    events: list[str] = []
    node = started(events)
    while node.stamp_ns < 3 * node.period_ns:
        command(node)
    node.stopping()
    stopped_at = node.stamp_ns
    for _ in range(10_000):
        command(node)
    assert node.stamp_ns == stopped_at
    node.stopping()
    assert events.count("stopped") == 1
    node.destroy_node()


@MODES
def test_a_simulator_asked_to_end_begins_no_run(arguments: Any, lockstep: str) -> None:
    arguments(f"lockstep.enabled:={lockstep}")
    node = SimulatorNode()
    node.autostart()
    node._participants.missing = lambda now: []
    node.end()
    node._try_start()
    assert (node._running, node.stamp_ns) == (False, 0)
    assert not node._truth_published
    node.destroy_node()


@MODES
@pytest.mark.parametrize("end", ["finished", "stopped"])
def test_no_request_after_the_end_changes_the_record(
    arguments: Any, lockstep: str, end: str
) -> None:
    arguments(f"lockstep.enabled:={lockstep}", "wait_for:=[effort_command]", "duration:=0.05")
    events: list[str] = []
    node = started(events)
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
    node.destroy_node()


@MODES
def test_a_run_that_failed_fails_once(arguments: Any, lockstep: str) -> None:
    arguments(f"lockstep.enabled:={lockstep}", "wait_for:=[effort_command,recorder]")
    events: list[str] = []
    node = started(events)
    node._simulation.status = PlantStatus(PlantState(0.0, inf, 0.0, 0.0), 0.0, False, False)
    node._on_command(sample_to_wire(JointSample(0, ("trunk",), effort=(1.0,))))
    # In real time twenty steps are due at once.
    node._pacing.tick(time.monotonic_ns() + 20 * node.period_ns)
    for stamp_ns in (0, node.period_ns):
        node._on_progress(sample_to_wire(JointSample(stamp_ns, ("recorder",))))
    assert events.count("failed") == 1
    assert node.exit_code == 1
    node.destroy_node()


def test_an_end_without_a_count_of_states_is_malformed(arguments: Any, tmp_path: Path) -> None:
    arguments(f"output:={tmp_path / 'run.mcap'}")
    node = RecorderNode()
    node.autostart()
    node._on_event(event(0, "/simulator", "finished", {"states": "many"}))
    node._on_event(event(0, "/simulator", "finished"))
    assert node.counters["events malformed"] == 2
    assert not node.verdict()[0]
    node.close()


@pytest.mark.parametrize("torque", [0.0, 3.0])
def test_a_run_is_not_complete_without_the_commands_that_drove_it(
    arguments: Any, tmp_path: Path, torque: float
) -> None:
    lockstep = ("lockstep.enabled:=true", f"lockstep.topics:=[{topics.GROUND_TRUTH}]")
    arguments(f"output:={tmp_path / 'run.mcap'}", *lockstep)
    node = RecorderNode()
    node.autostart()
    for stamp_ns, effort in ((0, 0.0), (10**6, torque)):
        node._on_truth(
            sample_to_wire(JointSample(stamp_ns, ("hip", "trunk"), effort=(0.0, effort)))
        )
    node._account.counts.update({("", topics.GROUND_TRUTH): 2, ("", topics.JOINT_STATES): 2})
    node._on_event(event(0, "/simulator", "finished", {"states": "2"}))
    complete, why = node.verdict()
    assert complete == (torque == 0.0), why
    assert ("a torque acted on the plant" in why) == (torque != 0.0)
    node.close()


def test_no_parameter_of_anybodys_ends_a_recorder(arguments: Any, tmp_path: Path) -> None:
    arguments(f"output:={tmp_path / 'run.mcap'}")
    node = RecorderNode()
    node.autostart()
    for values in ({"duration": "abc"}, {"duration": 0.5}, {"duration": True}):
        node._on_change(parameter_event(0, "/mine", values, {}, source="mine@boot.1.1"))
    assert node.exit_code is None
    node.close()


def test_a_recorder_that_ends_looks_for_messages_first(
    arguments: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long nothing has come, and however much time a busy machine lets pass between turns."""
    arguments(f"output:={tmp_path / 'run.mcap'}")
    node = RecorderNode()
    node.autostart()
    passed_s = itertools.count(time.monotonic(), 10.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(passed_s))
    node._on_event(event(0, "/simulator", "finished", {"states": "0"}))
    turns = list(itertools.takewhile(lambda _: node.draining(), range(100)))
    monkeypatch.undo()
    assert 10 <= len(turns) < 100
    node.close()


def disturb(node: SimulatorNode, stamp_ns: int) -> None:
    sample = JointSample(stamp_ns, ("hip", "trunk"), position=(0.0, 0.0), effort=(0.0, 1.0))
    node._on_disturbance(sample_to_wire(sample))


@MODES
def test_no_event_says_how_many_disturbances_were_taken(arguments: Any, lockstep: str) -> None:
    """In real time each row of ``plant/inputs`` names the one in force."""
    arguments(f"lockstep.enabled:={lockstep}", "wait_for:=[effort_command]", "duration:=0.0")
    events: list[str] = []
    node = started(events)
    for k in (0, 1, 1, 2):  # one comes twice
        disturb(node, k * node.period_ns)
    node.end()
    assert events[events.index("started") + 1 :] == ["refused", "finished"]
    node.destroy_node()


@pytest.mark.parametrize("end", ["finished", "stopped"])
def test_a_disturbance_after_the_end_is_not_counted(arguments: Any, end: str) -> None:
    arguments("wait_for:=[effort_command]", "duration:=0.05")
    events: list[str] = []
    node = started(events)
    while end == "finished" and node.exit_code is None:
        command(node)
    node.end()
    disturb(node, node.stamp_ns)
    assert events[-1] == end
    node.destroy_node()


HALVES = {
    "four efforts": {"effort": (1.0, 2.0, 3.0, 4.0)},
    "four positions": {"position": (1.0, 2.0, 3.0, 4.0)},
    "three efforts, one position": {"effort": (1.0, 2.0, 3.0), "position": (4.0,)},
    "efforts alone": {"effort": (1.0, 2.0)},
}


@pytest.mark.parametrize("values", HALVES.values(), ids=HALVES)
def test_each_field_of_a_disturbance_has_a_value_per_joint(arguments: Any, values: Any) -> None:
    arguments("wait_for:=[effort_command]")
    node = SimulatorNode()
    node.autostart()
    node._on_disturbance(sample_to_wire(JointSample(0, ("hip", "trunk"), **values)))
    assert node.counters == {"disturbances malformed": 1}
    assert not node._disturbances
    whole = JointSample(0, ("hip", "trunk"), position=(3.0, 4.0), effort=(1.0, 2.0))
    node._on_disturbance(sample_to_wire(whole))
    node._disturbances.advance(0, None)
    assert node._disturbances.disturbance == Disturbance(1.0, 2.0, 3.0, 4.0)
    node.destroy_node()
