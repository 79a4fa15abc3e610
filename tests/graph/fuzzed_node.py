"""Any node under random calls: its parameters, transitions and timers, and what must hold after each."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable
from typing import Any, ClassVar

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Parameter as ParameterMessage

from trunk_msgs_util.node.base import TrunkNode
from trunk_msgs_util.node.conversions import WireReader
from trunk_msgs_util.node.managed import ENDING
from trunk_msgs_util.parameters.declarations import declarations, values_of
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import LAST_STAMP_NS

from .fuzzed_inputs import TRANSITIONS, bounded, message, values

PERIOD_NS = 5_000_000


class Callbacks(RuleBasedStateMachine):
    """A live node, driven as its executor would: by calling the callbacks that it has registered."""

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


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
