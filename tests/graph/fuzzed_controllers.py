"""A controller under random states, references, resets and limits: each command is finite and allowed."""

from __future__ import annotations

from math import isfinite

from hypothesis import strategies as st
from hypothesis.stateful import invariant, rule

from trunk_msgs_util import topics
from trunk_msgs_util.node.conversions import sample_to_wire
from trunk_msgs_util.samples import JointSample

from .fuzzed_inputs import DAMAGE, RAW, STAMPS, damaged, message, numbers, ordinary, samples
from .fuzzed_node import Callbacks


class Controllers(Callbacks):
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
