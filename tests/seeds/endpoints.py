"""Publishers, subscriptions and services of the virtual library."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from . import cdr
from .base import Handle, Node, here, quality_of, real, resolve, type_name, world
from .network import Reader, Writer


class _Side(Handle):
    """A publisher or a subscription."""

    def __init__(
        self, join: Callable[..., Any], node: Node, kind: Any, topic: str, profile: Any
    ) -> None:
        super().__init__()
        name = resolve(node, topic)
        given = here(), (node.name, node.namespace), name, type_name(kind), quality_of(profile)
        self.endpoint: Any = join(*given)

    def get_topic_name(self) -> str:
        return str(self.endpoint.topic)

    def get_logger_name(self) -> str:
        return str(self.endpoint.node[0])

    def destroyed(self) -> None:
        world().network.remove(self.endpoint)


class Publisher(_Side):
    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        super().__init__(world().network.writer, node, kind, topic, profile)
        self.writer: Writer = self.endpoint

    def publish(self, message: Any) -> None:
        data = real().rclpy_serialize(message, type(message))
        self.publish_raw(data[: cdr.size(message)])

    def publish_raw(self, data: bytes) -> None:
        world().network.publish(self.writer, bytes(data))

    def get_subscription_count(self) -> int:
        return len(self.writer.matched)

    def wait_for_all_acked(self, duration: Any) -> bool:
        """Let others run until all is received, or for the duration."""
        end_ns = world().now_ns + int(duration.nanoseconds)
        while not world().network.acknowledged(self.writer) and world().now_ns < end_ns:
            world().block(
                end_ns - world().now_ns, lambda: world().network.acknowledged(self.writer)
            )
        return world().network.acknowledged(self.writer)


class Subscription(_Side):
    def __init__(self, node: Node, kind: Any, topic: str, profile: Any) -> None:
        super().__init__(world().network.reader, node, kind, topic, profile)
        self.reader: Reader = self.endpoint

    def take_message(self, kind: Any, raw: bool) -> tuple[Any, dict[str, int]] | None:
        """Return the oldest message and what is known of it, or None."""
        if not self.reader.queue:
            return None
        message = self.reader.queue.popleft()
        world().note("take", self.reader.process.name, self.reader.topic, message.number)
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
