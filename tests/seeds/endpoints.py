"""Publishers, subscriptions and services of the virtual library."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from . import cdr
from .base import Handle, Node, here, quality_of, real, resolve, type_name, world


class Publisher(Handle):
    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        super().__init__()
        self._topic = resolve(node, topic)
        self.writer = world().network.writer(
            here(), (node.name, node.namespace), self._topic, type_name(kind), quality_of(profile)
        )

    def publish(self, message: Any) -> None:
        data = real().rclpy_serialize(message, type(message))
        self.publish_raw(data[: cdr.size(message)])

    def publish_raw(self, data: bytes) -> None:
        world().network.publish(self.writer, bytes(data))

    def get_subscription_count(self) -> int:
        return len(self.writer.matched)

    def get_topic_name(self) -> str:
        return self._topic

    def get_logger_name(self) -> str:
        return self.writer.node[0]

    def wait_for_all_acked(self, duration: Any) -> bool:
        """Let others run until all is received, or for the duration."""
        limit_ns = int(str(duration.nanoseconds)) if hasattr(duration, "nanoseconds") else 10**9
        end_ns = world().now_ns + limit_ns
        while not world().network.acknowledged(self.writer) and world().now_ns < end_ns:
            world().block(
                end_ns - world().now_ns, lambda: world().network.acknowledged(self.writer)
            )
        return world().network.acknowledged(self.writer)

    def destroyed(self) -> None:
        world().network.remove(self.writer)


class Subscription(Handle):
    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        super().__init__()
        self._topic = resolve(node, topic)
        self.reader = world().network.reader(
            here(), (node.name, node.namespace), self._topic, type_name(kind), quality_of(profile)
        )

    def take_message(self, kind: Any, raw: bool) -> tuple[Any, dict[str, int]] | None:
        """Return the oldest message and what is told of it, or None."""
        if not self.reader.queue:
            return None
        message = self.reader.queue.popleft()
        world().note("take", self.reader.process.name, self._topic, message.number)
        data = message.data if raw else real().rclpy_deserialize(message.data, kind)
        info = {
            "source_timestamp": message.source_ns,
            "received_timestamp": world().now_ns,
            "publication_sequence_number": message.number,
            "reception_sequence_number": None,
        }
        return data, info  # type: ignore[return-value]

    def get_publisher_count(self) -> int:
        return len(self.reader.publishers)

    def get_topic_name(self) -> str:
        return self._topic

    def get_logger_name(self) -> str:
        return self.reader.node[0]

    def destroyed(self) -> None:
        world().network.remove(self.reader)


class Service(Handle):
    """A service whose requests come from the test itself."""

    def __init__(self, node: Node, kind: Any, name: str, profile: Any) -> None:
        super().__init__()
        self.name = resolve(node, name)
        self.kind, self.process = kind, here()
        self.qos = {"depth": 10}
        self.requests: deque[tuple[Any, Callable[[Any], None]]] = deque()
        services.setdefault(self.name, []).append(self)

    def service_take_request(self, kind: Any) -> tuple[Any, Any] | tuple[None, None]:
        if not self.requests:
            return None, None
        request, answer = self.requests.popleft()
        return request, Header(answer)

    def service_send_response(self, response: Any, request_id: Header) -> None:
        request_id.answer(response)

    def get_logger_name(self) -> str:
        return self.name

    def destroyed(self) -> None:
        services[self.name].remove(self)


class Header:
    """Whose request it is."""

    def __init__(self, answer: Callable[[Any], None]) -> None:
        self.answer = answer
        self.request_id = self


services: dict[str, list[Service]] = {}
