"""The simulator under random commands, disturbances, resets and pauses: each state is finite."""

from __future__ import annotations

from math import isfinite

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import strategies as st
from hypothesis.stateful import invariant, rule

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import sample_to_wire
from trunk_msgs_util.samples import JointSample
from trunk_sim.simulator_node import SimulatorNode

from .fuzzed_inputs import DAMAGE, NAMES, RAW, STAMPS, anything, damaged, samples
from .fuzzed_node import PERIOD_NS, Callbacks


class Simulators(Callbacks):
    """In lock-step, so that the plant steps with each answer and not by the clock."""

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
