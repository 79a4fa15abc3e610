"""LoopExecutor does with rclpy's own entities what rclpy's executor does."""

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities, Waitable
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from trunk_msgs_util.node import execution as run
from trunk_msgs_util.node import qos
from trunk_msgs_util.node.execution import LoopExecutor

pytestmark = pytest.mark.graph


class Loop:
    """A node in a LoopExecutor."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("loop", context=self.context, start_parameter_services=False)
        self.executor = LoopExecutor(context=self.context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def every(self, period_s: float, callback: Callable[[], object]) -> Timer:
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        return self.node.create_timer(period_s, callback, clock=clock)

    def spin_until(self, condition: Callable[[], object]) -> None:
        while not condition():
            self.executor.spin_once(timeout_sec=0.05)


@pytest.fixture
def loop(domain: int) -> Iterator[Loop]:
    made = Loop()
    yield made
    made.close()


def test_a_timer_keeps_its_rate(loop: Loop) -> None:
    calls: list[float] = []
    began = time.monotonic()
    loop.every(0.01, lambda: calls.append(time.monotonic()))
    loop.spin_until(lambda: len(calls) >= 30)
    # As many calls as periods or, on a busy machine, fewer: a timer that is late does not catch up.
    assert calls[-1] - began > 0.01 * len(calls) - 0.005


def test_an_event_that_makes_a_subscription_leaves_the_others_their_turn(loop: Loop) -> None:
    """rclpy keeps what else was ready for its next turn, by places in a wait set that is then outdated."""
    other = Node("other", context=loop.context, start_parameter_services=False)
    silent = Node("silent", context=loop.context, start_parameter_services=False)
    heard: list[str] = []

    def listen(node: Node, topic: str) -> None:
        def incompatible(_: object) -> None:
            heard.append(topic)
            if topic == "a":
                listen(loop.node, "c")

        events = SubscriptionEventCallbacks(incompatible_qos=incompatible)
        node.create_subscription(
            JointState, topic, lambda _: None, qos.evidence(), event_callbacks=events
        )

    listen(loop.node, "a")
    listen(other, "b")
    for topic in ("a", "b", "c"):
        silent.create_publisher(JointState, topic, qos.live())
    loop.executor.add_node(other)
    loop.spin_until(lambda: len(heard) == 3)
    assert sorted(heard) == ["a", "b", "c"]
    other.destroy_node()
    silent.destroy_node()


def test_a_cancelled_timer_rests_until_it_is_reset(loop: Loop) -> None:
    rests: list[None] = []
    beats: list[None] = []
    timer = loop.every(0.001, lambda: rests.append(None))
    loop.spin_until(lambda: rests)
    timer.cancel()
    before = len(rests)
    loop.every(0.005, lambda: beats.append(None))
    loop.spin_until(lambda: len(beats) > 5)
    assert len(rests) == before
    timer.reset()
    loop.spin_until(lambda: len(rests) > before)


def test_a_timer_may_destroy_another(loop: Loop) -> None:
    calls: list[str] = []

    def first() -> None:
        calls.append("first")
        if second in loop.node.timers:
            loop.node.destroy_timer(second)

    loop.every(0.005, first)
    second = loop.every(0.005, lambda: calls.append("second"))
    loop.spin_until(lambda: calls.count("first") > 5)
    assert calls.count("second") <= 1


def test_timers_and_services_have_their_turn_among_messages(loop: Loop) -> None:
    publisher = loop.node.create_publisher(JointState, "loop/messages", 10)
    heard: list[JointState] = []
    beats: list[None] = []

    def again(message: JointState) -> None:
        heard.append(message)
        publisher.publish(message)  # to itself: there is always a message

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = "here"
        return response

    loop.node.create_subscription(JointState, "loop/messages", again, 10)
    loop.node.create_service(Trigger, "loop/service", answer)
    client = loop.node.create_client(Trigger, "loop/service")
    loop.spin_until(lambda: publisher.get_subscription_count() and client.service_is_ready())
    for _ in range(5):
        publisher.publish(JointState())
    loop.spin_until(lambda: len(heard) > 100)
    loop.every(0.01, lambda: beats.append(None))
    future = client.call_async(Trigger.Request())
    loop.spin_until(lambda: future.done() and len(beats) > 5)
    assert future.result().message == "here"


def test_timers_wait_two_milliseconds_for_messages_at_most(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns, calls = 0, [0]

    def take(self: LoopExecutor, rare_ones: bool) -> bool:
        nonlocal now_ns
        now_ns += 500_000
        return True  # messages never end

    monkeypatch.setattr(run, "time", SimpleNamespace(monotonic_ns=lambda: now_ns))
    monkeypatch.setattr(LoopExecutor, "_take_messages", take)
    loop.every(1e-9, lambda: calls.append(now_ns))
    while now_ns < 50_000_000:
        loop.executor.spin_once()
    assert max(later - one for one, later in pairwise([*calls, now_ns])) <= 2_500_000


def test_after_a_wait_that_a_message_ended_more_of_them_collect(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready, slept = ["a message"], list[float]()
    clock = SimpleNamespace(monotonic_ns=time.monotonic_ns, sleep=slept.append)
    monkeypatch.setattr(run, "time", clock)
    monkeypatch.setattr(loop.executor, "_linger_s", lambda: 0.01)
    loop.executor.spin_once(0.0)
    waited = MagicMock(get_ready_entities=lambda kind: ready if kind == "subscription" else [])
    monkeypatch.setattr(loop.executor, "_wait_set", waited)
    slept.clear()
    loop.executor.spin_once(0.0)
    ready.clear()
    loop.executor.spin_once(0.0)
    assert slept == [0.01]


def test_messages_collect_no_longer_than_each_node_lets_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recorder, pid = (MagicMock(linger_s=0.01, exit_code=0, unfinished=False) for _ in range(2))
    made = MagicMock()
    for name in ("LoopExecutor", "Interrupt", "_initialize", "_drain"):
        monkeypatch.setattr(run, name, made if name == "LoopExecutor" else MagicMock())
    assert run.run_nodes({"recorder": lambda: recorder, "pid": lambda: pid}, "recorder", []) == 0
    (linger_s,) = made.call_args.args
    pid.linger_s = 0.0
    assert linger_s() == 0.0


def test_a_rare_message_is_taken_while_others_keep_coming(loop: Loop) -> None:
    often = loop.node.create_publisher(JointState, "often", 10)
    rarely = loop.node.create_publisher(JointState, "rarely", 10)
    turns: list[JointState] = []
    rare: list[int] = []

    def again(message: JointState) -> None:
        turns.append(message)
        often.publish(message)  # there is never a turn without a message
        if len(turns) == 300:
            rarely.publish(message)

    loop.node.create_subscription(JointState, "often", again, 10)
    loop.node.create_subscription(JointState, "rarely", lambda _: rare.append(len(turns)), 10)
    loop.spin_until(lambda: often.get_subscription_count() and rarely.get_subscription_count())
    often.publish(JointState())
    loop.spin_until(lambda: rare)
    assert rare[0] >= 300


def test_an_event_of_the_middleware_is_handled_though_no_message_comes(loop: Loop) -> None:
    """A publisher whose messages cannot be heard sends nothing that would wake the loop."""
    refused: list[int] = []
    beats: list[None] = []
    loop.node.create_subscription(
        JointState,
        "refused",
        lambda _: None,
        qos.control(),
        event_callbacks=SubscriptionEventCallbacks(
            incompatible_qos=lambda event: refused.append(event.total_count)
        ),
    )
    loop.every(0.01, lambda: beats.append(None))
    loop.spin_until(lambda: len(beats) > 5)  # by now it only waits
    other = Loop()
    try:
        other.node.create_publisher(JointState, "refused", qos.view())
        loop.spin_until(lambda: refused)
    finally:
        other.close()
    assert refused == [1]


def test_a_guard_condition_is_handled(loop: Loop) -> None:
    """A wait takes note of a trigger only once: rclpy, which calls back, must still see it."""
    handled: list[None] = []
    guard = loop.node.create_guard_condition(lambda: handled.append(None))
    loop.executor.spin_once(timeout_sec=0.05)
    for count in (1, 2):
        guard.trigger()
        loop.spin_until(lambda count=count: len(handled) >= count)
        loop.executor.spin_once(timeout_sec=0.05)
        assert len(handled) == count


def test_a_waitable_with_a_subscription_is_handled(loop: Loop) -> None:
    """A waitable may wait for more than events of the middleware."""
    handled: list[Any] = []
    heard = loop.node.create_subscription(JointState, "heard", lambda _: None, 10)

    class Hearing(Waitable):
        """Waits for messages of its own subscription."""

        def __init__(self) -> None:
            super().__init__(ReentrantCallbackGroup())
            self._place = 0

        def __enter__(self) -> None:
            heard.handle.__enter__()

        def __exit__(self, *exception: object) -> None:
            heard.handle.__exit__(*exception)

        def get_num_entities(self) -> NumberOfEntities:
            return NumberOfEntities(num_subs=1)

        def add_to_wait_set(self, wait_set: Any) -> None:
            self._place = wait_set.add_subscription(heard.handle)

        def is_ready(self, wait_set: Any) -> bool:
            return bool(wait_set.is_ready("subscription", self._place))

        def take_data(self) -> Any:
            return heard.handle.take_message(JointState, False)

        async def execute(self, taken: Any) -> None:
            handled.append(taken)

    publisher = loop.node.create_publisher(JointState, "heard", 10)
    loop.spin_until(publisher.get_subscription_count)
    loop.node._subscriptions.remove(heard)
    loop.node.add_waitable(Hearing())
    loop.executor.spin_once(timeout_sec=0.05)
    publisher.publish(JointState(name=["trunk"]))
    loop.spin_until(lambda: handled)
    assert handled[0][0].name == ["trunk"]
