"""Parameters changed by ROS 2's ordinary services: checked as a set, active at once, and recorded."""

import re
from itertools import count

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from trunk_control.rule_tables import KP_AS_PRINTED
from trunk_core.samples import JointSample
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_recording.reader import Recording

from ..refusals import REFUSALS
from .peer import Peer
from .processes import Child, Children
from .services import Services
from .verbs import verified

pytestmark = pytest.mark.graph

PERIOD_NS = 5_000_000


@pytest.fixture
def pid(children: Children, peer: Peer) -> Child:
    node = children.node("pid", "gains.i:=0.0", "gains.d:=0.0")
    peer.until_up("pid")
    yield node
    assert node.stop() == 0
    assert "Traceback" not in node.stderr


@pytest.mark.virtual
def test_parameters_are_described(pid: Child, peer: Peer) -> None:
    gain, low, high, rate, mode, values = Services(peer, "pid").describe(
        "gains.p",
        "u_clamp_min",
        "i_clamp_max",
        "update_rate",
        "derivative_mode",
        "reference.values",
    )
    assert gain.description == "Proportional gain [N m/rad]"
    assert gain.additional_constraints == "double, >= 0 and <= 1e+09"
    (bounds,) = gain.floating_point_range
    assert (bounds.from_value, bounds.to_value) == (0.0, 1e9)
    assert low.floating_point_range == []
    assert high.floating_point_range[0].from_value == 0.0
    assert rate.read_only
    assert rate.description.endswith("[Hz]")
    assert not gain.read_only
    assert mode.additional_constraints == "string, one of error, measurement, rate"
    assert values.type == Parameter.Type.DOUBLE_ARRAY.value


@pytest.mark.virtual
def test_stored_is_active_and_published(pid: Child, peer: Peer) -> None:
    """The test plays the plant: it publishes states and receives the command that answers each."""
    commands, services = peer.hear("effort_command"), Services(peer, "pid")
    say, steps = peer.speaker("joint_states"), count()

    def answer() -> float:
        """Return the command that answers the next state: an error of -0.25 rad."""
        stamp_ns = next(steps) * PERIOD_NS
        say(JointSample(stamp_ns, ("hip", "trunk"), (0.0, 0.25), (0.0, 0.0)))
        peer.until(
            lambda: commands and stamp_from_ros(commands[-1].header.stamp) == stamp_ns,
            "the controller answers",
        )
        return commands[-1].effort[0]

    assert [answer() for _ in range(3)] == [-0.25 * 60.0] * 3
    assert services.set(gains__p=80).successful  # an integer is accepted as a double
    assert repr(services.get("gains.p")) == "[80.0]"
    assert answer() == -0.25 * 80.0

    changes = peer.until(lambda: [p for p in peer.parameters if p.changed], "it is published")
    assert [(c.node, c.stamp_ns, c.changed) for c in changes] == [
        ("/pid", 2 * PERIOD_NS, {"gains.p": 80.0})
    ]
    for value in (-1.0, [1.0] * 100_000, None):
        for result in (services.set(gains__p=value), services.set_together(gains__p=value)):
            assert not result.successful
            assert result.reason.startswith("parameter 'gains.p': ")
            assert result.reason.endswith(" is not allowed: double, >= 0 and <= 1e+09")
            assert len(result.reason) < 200
    assert services.get("gains.p") == [80.0]
    assert answer() == -0.25 * 80.0
    assert len([p for p in peer.parameters if p.changed]) == 1


@pytest.mark.virtual
@pytest.mark.parametrize("name", dict.fromkeys(refusal.node for refusal in REFUSALS))
def test_a_running_node_refuses_what_it_would_not_start_with(
    children: Children, peer: Peer, name: str
) -> None:
    node = children.node(name)
    peer.until_up(name)
    services = Services(peer, name)
    for refusal in (refusal for refusal in REFUSALS if refusal.node == name):
        result = services.set_together(**refusal.values)
        assert not result.successful
        refusal.running.check(result.reason)
    assert [p for p in peer.parameters if p.changed] == []
    assert node.stop() == int(name == "recorder"), node.stderr  # of no run at all


@pytest.mark.virtual
def test_every_refusal_names_what_is_refused(pid: Child, peer: Peer) -> None:
    services = Services(peer, "pid")
    for values, *reasons in (
        ({"use_sim_time": 3}, "'use_sim_time': Wrong parameter type, expected 'Type.BOOL'"),
        (
            {"gains__p": -1.0, "gains__i": 7.0, "gains__d": "x", "joint": "hip"},
            "'gains.p': -1.0 is not allowed: double, >= 0",
            "; parameter 'gains.d': 'x' is not allowed: double, >= 0",
            "; parameter 'joint': 'hip' is not allowed: fixed at start, to 'trunk'",
        ),
    ):
        result = services.set_together(**values)
        assert not result.successful
        for reason in reasons:
            assert reason in result.reason
    assert services.get("gains.i") == [0.0], "right by itself, but set together with wrong ones"
    assert services.set(reference__times=[1, 2], reference__values=[3, 4]).successful is False
    assert services.set_together(reference__times=[1, 2], reference__values=[3, 4]).successful
    assert repr(services.get("reference.times")) == "[[1.0, 2.0]]"
    assert services.set_together(reference__times=[], reference__values=[]).successful

    # Of three set one by one, only the wrong one is refused.
    results = services.set_each(gains__p=1.0, gains__i=-1.0, gains__d=2.0)
    assert [result.successful for result in results] == [True, False, True]
    assert services.get("gains.p", "gains.i", "gains.d") == [1.0, 0.0, 2.0]

    strange = ParameterMessage(name="gains.p", value=ParameterValue(type=77))  # not a type of ROS 2
    for kind, service in (
        (SetParameters, "set_parameters"),
        (SetParametersAtomically, "set_parameters_atomically"),
    ):
        response = peer.call(kind, f"/pid/{service}", parameters=[strange])
        result = response.result if kind is SetParametersAtomically else response.results[0]
        assert result.reason == "parameter 'gains.p': 77 is not a parameter type"
    assert services.get("gains.p") == [1.0]


@pytest.mark.virtual
def test_linked_values_and_rules(children: Children, peer: Peer) -> None:
    node = children.node("fuzzy_pid", "rules.kd.NB.PB:=B")
    peer.until_up("fuzzy_pid")
    services = Services(peer, "fuzzy_pid")

    result = services.set(gains__p_min=70.0)
    assert not result.successful
    assert "'gains.p_max': 60.0 is not allowed: at least gains.p_min (70)" in result.reason
    assert services.set_together(gains__p_min=70.0, gains__p_max=90.0).successful
    assert not services.set_together(gains__p_min=40.0, gains__p_max=30.0).successful
    assert services.get("gains.p_min", "gains.p_max") == [70.0, 90.0]

    assert services.get("rules.kd")[0][0] == "S S S S S S B"  # from the command line
    rows = list(KP_AS_PRINTED)
    rows[1] = "S B B B B B S"
    assert services.set(rules__kp=rows).successful
    assert services.get("rules.kp") == [rows]
    assert not services.set(rules__kp__NM__PB="X").successful

    peer.until(lambda: len([p for p in peer.parameters if p.changed]) == 2, "changes are published")
    changes = peer.until(lambda: [p for p in peer.parameters if p.changed], "it is published")
    assert [(c.stamp_ns, c.changed) for c in changes] == [
        (-1, {"gains.p_min": 70.0, "gains.p_max": 90.0}),
        (-1, {"rules.kp": rows}),
    ]
    assert node.stop() == 0


def test_change_in_a_recorded_run_is_replayed(children: Children, peer: Peer) -> None:
    truth = peer.hear("ground_truth/joint_states")
    folder = children.folder / "changed"
    run = children.trunk(
        "run", "demo", "--lockstep", "--speed", 0.02, "--duration", 5.0, "--output", folder
    )
    services, plant = Services(peer, "fuzzy_pid"), Services(peer, "simulator")
    peer.until(lambda: len(truth) > 5, "the run goes on")
    assert services.set_together(gains__p_min=50.0, gains__p_max=90.0).successful
    assert plant.set(plant__trunk_mass=0.75).successful
    peer.until(lambda: len(truth) > 10, "the run goes on")
    assert services.set(antiwindup_strategy="none").successful
    assert plant.set(lockstep__speed=0.0).successful  # slow only until here
    assert run.wait() == 0, run.stderr
    children.none_left()

    recording = Recording.open(folder / "run.mcap")
    assert recording.complete, recording.warnings
    changes = [c for c in recording.parameter_messages("/run/parameters") if c.changed]
    nodes = sorted(change.node for change in changes)
    assert nodes == ["/fuzzy_pid", "/fuzzy_pid", "/simulator", "/simulator"]
    assert all(0 < change.stamp_ns < 5_000_000_000 for change in changes)
    text = verified(folder / "run.mcap")
    assert re.search("states of the plant .* 1001 +verified", text)
