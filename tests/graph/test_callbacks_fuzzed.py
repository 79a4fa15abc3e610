"""Random parameters, messages, resets and jumps in time, through the real callbacks of real nodes.

Always: a command is finite and within the active limits, the stored parameters are the active ones,
nothing is raised, and counters only grow. The examples are the same each time; ``TRUNK_FUZZ=80`` makes
eighty times as many, different ones each time.
"""

import gc
import os
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from math import inf, isfinite, nan, pi
from sys import float_info
from typing import Any, ClassVar

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    rule,
    run_state_machine_as_test,
)
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from trunk_control.controller_node import ControllerNode
from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.parameters.declarations import Declaration, declarations, values_of
from trunk_core.samples import JointSample
from trunk_core.units import LAST_STAMP_NS
from trunk_msgs_util.node.base import ENDING, TrunkNode
from trunk_msgs_util.node.conversions import WireReader, sample_to_wire
from trunk_sim.simulator_node import SimulatorNode

pytestmark = [pytest.mark.graph, pytest.mark.slow]

PERIOD_NS = 5_000_000
EXTREME = (0.0, -0.0, 5e-324, 1e-200, 1e200, float_info.max, -1e200, -float_info.max)
BAD = (nan, inf, -inf)

ordinary = st.floats(-pi, pi)
numbers = ordinary | ordinary | st.sampled_from(EXTREME)
anything = st.one_of(numbers, numbers, numbers, st.sampled_from(BAD))


# Values of parameters.


def bounded(declaration: Declaration) -> st.SearchStrategy[Any]:
    """Return values that a declaration allows, its bounds among them."""
    low = declaration.minimum if declaration.minimum is not None else declaration.above
    high = declaration.maximum
    if declaration.choices:
        return st.sampled_from(declaration.choices)
    kind = declaration.kind.removesuffix(" array")
    if kind == "double":
        floats = st.floats(
            low,
            high,
            exclude_min=declaration.above is not None,
            allow_nan=False,
            allow_infinity=declaration.unbounded,
        )
        near = (declaration.default, 5e-324, 1e-300, low, high, 1.0, 7)
        ends = st.sampled_from([v for v in near if isinstance(v, int | float)])
        return floats | ends | ends
    if kind == "integer":
        return st.integers(int(low or 0), int(high or 2**31 - 1))
    if kind == "bool":
        return st.booleans()
    if declaration.name.startswith("rules."):
        labels = "S MS M B" if declaration.name == "rules.alpha" else "S B"
        row = st.lists(st.sampled_from(labels.split()), min_size=7, max_size=7).map(" ".join)
        return row | st.just(declaration.default[0])
    return st.sampled_from(["trunk", "hip", "", "X"])


WRONG = st.one_of(
    st.sampled_from(BAD),
    st.sampled_from(EXTREME),
    st.sampled_from([None, True, 2**63 - 1, -(2**63), "", "B B", "\u03b8", "x" * 100_000]),
    st.sampled_from([[], [nan], [True], [1, 2], ["a"] * 7, ["S " * 7] * 7, [0.5] * 20_000, [b"x"]]),
    st.lists(st.floats(), max_size=8),
)


def values(declaration: Declaration) -> st.SearchStrategy[Any]:
    """Return values for a parameter: most are allowed, the others of any kind."""
    right = bounded(declaration)
    if declaration.kind.endswith("array"):
        length = declaration.length
        right = st.lists(right, min_size=length or 0, max_size=length if length is not None else 4)
        if declaration.name.endswith(("peaks", "times")):
            right = right.map(sorted)
        right = right | st.just(list(declaration.default))
    return st.one_of(right, right, right, WRONG)


def message(name: str, value: Any) -> ParameterMessage:
    try:
        return Parameter(name, value=value).to_parameter_msg()
    except (TypeError, ValueError, AssertionError):  # a mixed list: ROS 2 cannot carry it
        return ParameterMessage(name=name, value=ParameterValue(type=200))


# Messages.

# Activate, deactivate, what is refused in every state, and numbers of no transition.
TRANSITIONS = st.sampled_from([3, 3, 4, 0, 1, 5, 99, 255])
STAMPS = st.sampled_from(
    ["next", "next", "next", "same", "back", "far", "last", "zero", "negative"]
)
NAMES = st.sampled_from(
    [("hip", "trunk")] * 6 + [("trunk", "hip"), ("trunk",), ("hip",), (), ("a", "trunk", "hip")]
)
SIZES = st.sampled_from(["right"] * 6 + ["none", "short", "huge"])
RAW = st.one_of(
    st.binary(max_size=80),
    st.sampled_from([b"", b"\x00", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + b"\xff" * 200]),
)
DAMAGE = st.sampled_from(["cut", "stamp", "flip", "tail", "big-endian"])


@st.composite
def quantities(draw: Any, count: int) -> tuple[float, ...]:
    size = draw(SIZES)
    if size == "huge":
        return (draw(anything),) * 50_000
    count = {"right": count, "none": 0, "short": max(count - 1, 0)}[size]
    return tuple(draw(st.lists(anything, min_size=count, max_size=count)))


@st.composite
def samples(draw: Any) -> JointSample:
    names = draw(NAMES)
    return JointSample(0, names, *(draw(quantities(len(names))) for _ in range(3)))


def damaged(data: bytes, how: str, at: int) -> bytes:
    at %= max(len(data), 1)
    if how == "cut":
        return data[:at]
    if how == "stamp":  # nanoseconds beyond a second push it past the largest stamp
        return data[:4] + struct.pack("<iI", 2**31 - 1, 2**32 - 1) + data[12:]
    if how == "flip":
        return data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :]
    if how == "tail":
        return data + b"\x00" * at
    return b"\x00\x00" + data[2:]


# Nodes.


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


class Callbacks(RuleBasedStateMachine):
    """A live node under random calls of the callbacks that it has registered, and what holds after each."""

    node_class: ClassVar[Callable[[], TrunkNode[Any]]]
    spied: ClassVar[tuple[str, ...]]
    steps: ClassVar[Counter[str]]

    def __init__(self) -> None:
        super().__init__()
        self.node = type(self).node_class()
        self.node.autostart()
        self.declared = declarations(type(self.node.config))
        self.said: list[tuple[str, JointSample]] = []
        self.counted: Counter[str] = Counter()
        self.stamp_ns = 0
        self._spy()
        self.begin()

    def begin(self) -> None:
        """Bring the node to the point where it answers."""

    def _spy(self) -> None:
        for publisher in self.node._replayable:
            if publisher.topic.lstrip("/") in self.spied:
                self._listen(publisher)

    def _listen(self, evidence: Any) -> None:
        publish, read = evidence.publish, WireReader()
        topic = evidence.topic.lstrip("/")

        def publish_and_tell(data: bytes) -> None:
            self.said.append((topic, read(data)))
            self.judge(*self.said[-1])
            publish(data)

        evidence.publish = publish_and_tell

    def judge(self, topic: str, sample: JointSample) -> None:
        """Fail if the node must not publish this now."""

    def teardown(self) -> None:
        """Leave the next example a graph without this node, which a second one would wait for."""
        self.node.destroy_node()
        del self.node  # listed in the graph for as long as anything refers to it
        gc.collect()

    def deliver(self, topic: str, data: Any) -> None:
        for subscription in self.node.subscriptions:
            if subscription.topic_name.lstrip("/") == topic:
                subscription.callback(data)

    def call(self, service: str, **fields: Any) -> Any:
        (found,) = [s for s in self.node.services if s.srv_name.endswith(f"/{service}")]
        kind = found.srv_type
        return found.callback(kind.Request(**fields), kind.Response())

    def set(self, together: bool, changes: list[ParameterMessage]) -> None:
        before = self.node.config
        service = "set_parameters_atomically" if together else "set_parameters"
        response = self.call(service, parameters=changes)
        results = [response.result] if together else response.results
        ending = self.node.ending
        for result in results:
            refused = result.reason.startswith(ENDING if ending else "parameter ")
            assert refused if ending else result.successful or refused, result.reason
        if not any(result.successful for result in results):
            assert self.node.config is before

    @rule(data=st.data(), together=st.booleans(), count=st.integers(1, 4))
    def set_some_parameters(self, data: st.DataObject, together: bool, count: int) -> None:
        names = [n for n, d in self.declared.items() if not d.fixed or data.draw(st.booleans())]
        chosen = data.draw(st.lists(st.sampled_from(names), min_size=count, max_size=count))
        drawn = [(name, data.draw(values(self.declared[name]))) for name in chosen]
        if data.draw(st.integers(0, 9)) == 0:
            drawn.append((data.draw(st.sampled_from(["", "gains.q", "x" * 999])), 1.0))
        self.set(together, [message(name, value) for name, value in drawn])

    @rule(data=st.data(), count=st.integers(1, 3))
    def set_allowed_parameters(self, data: st.DataObject, count: int) -> None:
        """Each valid by itself: most of them become active."""
        free = [d for d in self.declared.values() if not (d.fixed or d.kind.endswith("array"))]
        gains = [d for d in free if d.name.startswith(("gains.", "plant.", "model."))]
        for _ in range(count):
            one = data.draw(st.sampled_from(gains) | st.sampled_from(gains) | st.sampled_from(free))
            self.set(True, [message(one.name, data.draw(bounded(one)))])

    @rule(together=st.booleans())
    def set_the_defaults_again(self, together: bool) -> None:
        """Whatever other rules have set, return to an ordinary configuration."""
        free = [d for d in self.declared.values() if not d.fixed]
        self.set(together, [message(d.name, _plain(d.default)) for d in free])

    @rule(number=TRANSITIONS)
    def transition(self, number: int) -> None:
        """Deactivate, activate, or request a transition that the current state does not have."""
        changed = self.call("change_state", transition=Transition(id=number)).success
        assert not (changed and self.node.ending)
        assert not changed or self.node.active == (number == Transition.TRANSITION_ACTIVATE)

    @rule()
    def go_on(self) -> None:
        self.transition(Transition.TRANSITION_ACTIVATE)

    @rule()
    def diagnose(self) -> None:
        for timer in list(self.node.timers):
            timer.callback()

    @invariant()
    def stored_is_active(self) -> None:
        type(self).steps["steps"] += 1
        for name, active in values_of(self.node.config).items():
            stored = self.node.get_parameter(name).value
            assert _plain(active) == (list(stored) if isinstance(active, tuple) else stored), name

    @invariant()
    def counters_grow(self) -> None:
        now = Counter(self.node.counters)
        assert not self.counted - now
        self.counted = now

    def next_stamp(self, how: str) -> int:
        moved = {
            "next": self.stamp_ns + PERIOD_NS,
            "same": self.stamp_ns,
            "back": max(self.stamp_ns - 3 * PERIOD_NS, 0),
            "far": self.stamp_ns + 10**18,
            "last": LAST_STAMP_NS,
            "zero": 0,
            "negative": -(2**31) * 10**9,
        }[how]
        return moved if -(2**31) * 10**9 <= moved <= LAST_STAMP_NS else 0


class Controllers(Callbacks):
    """Random states, references, resets and limits: each command is finite and allowed."""

    spied = (topics.EFFORT_COMMAND,)

    def begin(self) -> None:
        answered = len(self.said)
        for _ in range(2):  # in lock-step the first two states give the plant's rate
            self.state(JointSample(0, ("hip", "trunk"), (0.0, 0.1), (0.0, 0.0)), "next")
        assert len(self.said) == answered + 2

    def judge(self, topic: str, sample: JointSample) -> None:
        (effort,) = sample.effort
        config = self.node.config
        assert self.node.active
        assert isfinite(effort)
        assert config.u_clamp_min <= effort <= config.u_clamp_max

    @rule(sample=samples(), how=STAMPS)
    def state(self, sample: JointSample, how: str) -> None:
        self.stamp_ns = self.next_stamp(how)
        self.deliver(topics.JOINT_STATES, sample_to_wire(sample._replace(stamp_ns=self.stamp_ns)))

    @rule(
        motions=st.lists(st.tuples(numbers, numbers, numbers, numbers), min_size=1, max_size=8),
        how=st.sampled_from(["next", "next", "same", "far"]),
    )
    def wild_motions(self, motions: list[tuple[float, ...]], how: str) -> None:
        """Well-formed and finite, of any magnitude: all of it reaches the law."""
        for x, theta, x_dot, theta_dot in motions:
            self.state(JointSample(0, ("hip", "trunk"), (x, theta), (x_dot, theta_dot)), how)

    @rule(position=ordinary, rate=ordinary, count=st.integers(1, 5))
    def ordinary_states(self, position: float, rate: float, count: int) -> None:
        for _ in range(count):
            self.state(JointSample(0, ("hip", "trunk"), (0.0, position), (1.0, rate)), "next")

    @rule(data=RAW, topic=st.sampled_from([topics.JOINT_STATES, topics.REFERENCE]))
    def garbage(self, data: bytes, topic: str) -> None:
        self.deliver(topic, data)

    @rule(sample=samples(), how=DAMAGE, at=st.integers(0, 500))
    def damaged_state(self, sample: JointSample, how: str, at: int) -> None:
        self.deliver(topics.JOINT_STATES, damaged(sample_to_wire(sample), how, at))

    @rule(sample=samples())
    def reference(self, sample: JointSample) -> None:
        self.deliver(topics.REFERENCE, sample_to_wire(sample))

    @rule(low=st.floats(-50.0, 49.0), width=st.floats(0.01, 1.0))
    def narrow_the_limits(self, low: float, width: float) -> None:
        """In lock-step the very next answer obeys them, even if no update is due."""
        self.set(True, [message("u_clamp_min", low), message("u_clamp_max", low + width)])
        self.state(JointSample(0, ("hip", "trunk"), (0.0, 0.1), (0.0, 0.0)), "same")

    @rule()
    def clean_up(self) -> None:
        for number in (4, 2, 1, 3):  # deactivate, cleanup, configure, activate
            self.transition(number)
        assert self.node.active
        self.counted.clear()
        self._spy()
        self.set_the_defaults_again(True)
        self.stamp_ns = 0
        self.begin()

    @rule()
    def follow_the_topic(self) -> None:
        self.set(True, [message("reference.profile", "topic")])

    @rule()
    def reset(self) -> None:
        assert self.call("reset").success

    @invariant()
    def alive(self) -> None:
        assert self.node.exit_code is None


class Simulators(Callbacks):
    """Random commands, disturbances, resets and pauses: each state is finite.

    In lock-step, so that the plant steps with each answer and not by the clock.
    """

    spied = (topics.JOINT_STATES, topics.GROUND_TRUTH)
    node_class = SimulatorNode

    def begin(self) -> None:
        ready = [KeyValue(key="answers", value=topics.EFFORT_COMMAND)]
        status = DiagnosticStatus(name="/fuzz", message="ready", values=ready)
        # As if its publisher had been matched and had gone.
        self.node._participants._met.add(topics.EFFORT_COMMAND)
        self.deliver(topics.RUN_EVENTS, DiagnosticArray(status=[status]))
        self.diagnose()
        assert len(self.said) == 2, "the first state, true and measured"

    def judge(self, topic: str, sample: JointSample) -> None:
        assert all(map(isfinite, (*sample.position, *sample.velocity, *sample.effort)))
        assert sample.stamp_ns % PERIOD_NS == 0

    @rule(effort=anything, how=STAMPS, names=NAMES)
    def command(self, effort: float, how: str, names: tuple[str, ...]) -> None:
        now = self.said[-1][1].stamp_ns
        self.stamp_ns = now - PERIOD_NS
        stamp_ns = self.next_stamp(how)
        efforts = (effort,) * len(names)
        self.deliver(
            topics.EFFORT_COMMAND, sample_to_wire(JointSample(stamp_ns, names, effort=efforts))
        )

    @rule(efforts=st.lists(st.floats(-20.0, 20.0), max_size=5))
    def ordinary_commands(self, efforts: list[float]) -> None:
        for effort in efforts:
            self.command(effort, "next", ("trunk",))

    @rule(sample=samples(), how=STAMPS)
    def disturbance(self, sample: JointSample, how: str) -> None:
        self.stamp_ns = self.said[-1][1].stamp_ns
        stamp_ns = self.next_stamp(how)
        self.deliver(topics.DISTURBANCE, sample_to_wire(sample._replace(stamp_ns=stamp_ns)))

    @rule(data=RAW, topic=st.sampled_from([topics.EFFORT_COMMAND, topics.DISTURBANCE]))
    def garbage(self, data: bytes, topic: str) -> None:
        self.deliver(topic, data)

    @rule(
        sample=samples(),
        how=DAMAGE,
        at=st.integers(0, 500),
        topic=st.sampled_from([topics.EFFORT_COMMAND, topics.DISTURBANCE]),
    )
    def damaged_message(self, sample: JointSample, how: str, at: int, topic: str) -> None:
        self.deliver(topic, damaged(sample_to_wire(sample), how, at))

    @rule()
    def reset(self) -> None:
        assert self.call("reset").success != self.node.ending

    @rule(pause=st.booleans())
    def pause(self, pause: bool) -> None:
        assert not (self.call("pause", data=pause).success and self.node.ending)

    @invariant()
    def ends_by_divergence_alone(self) -> None:
        assert self.node.exit_code in (None, 1)


MORE = int(os.environ.get("TRUNK_FUZZ", "0"))
EXAMPLES, STEPS = 8, 50  # at most, of each node


def node_of(law: str) -> Callable[[], TrunkNode[Any]]:
    return partial(ControllerNode, law_named(law))


@pytest.fixture
def context(
    domain: int, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    # Each cleanup would wait for a recorder; there is none here.
    monkeypatch.setenv("TRUNK_PATIENCE", "0.001")
    rclpy.init(
        args=["--ros-args", "--log-level", "fatal", *request.param],
        signal_handler_options=SignalHandlerOptions.NO,
    )
    yield
    rclpy.try_shutdown()


LOCKSTEP = ("-p", "lockstep.enabled:=true")


@pytest.mark.timeout(600 * (1 + MORE))
@pytest.mark.parametrize(
    ("machine", "node", "context"),
    [
        (Controllers, node_of("pid"), ()),
        (Controllers, node_of("fuzzy_pid"), LOCKSTEP),
        (Controllers, node_of("lqr"), LOCKSTEP),
        (Controllers, node_of("computed_torque"), ()),
        (Simulators, SimulatorNode, LOCKSTEP),
    ],
    ids=["pid", "fuzzy_pid", "lqr", "computed_torque", "simulator"],
    indirect=["context"],
)
def test_whatever_comes(
    machine: type[Callbacks], node: Callable[[], TrunkNode[Any]], context: None
) -> None:
    fuzzed = type("Fuzzed", (machine,), {"node_class": node, "steps": Counter()})
    run_state_machine_as_test(
        fuzzed,
        settings=settings(
            max_examples=EXAMPLES * (MORE or 1),
            stateful_step_count=STEPS,
            derandomize=not MORE,
            database=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate, *([Phase.shrink] if MORE else [])],
        ),
    )
    assert fuzzed.steps["steps"] >= 40 * EXAMPLES
