"""External nodes: who they are, by discovery, and why a topic may be silent."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from difflib import SequenceMatcher
from itertools import product
from pathlib import Path
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from trunk_core import topics

from . import discovery

# The first two bytes of an endpoint's GUID name its DDS (OMG: DDSI-RTPS vendor ids).
_VENDORS = {
    0x0101: "RTI Connext",
    0x0102: "OpenSplice",
    0x0103: "OpenDDS",
    0x0106: "CoreDX",
    0x010F: "Fast DDS",
    0x0110: "Cyclone DDS",
    0x0111: "GurumDDS",
    0x0112: "RustDDS",
    0x0115: "Dust DDS",
}
# DDS discovers a publisher first and its node later; one without a node by then is no ROS node.
UNNAMED_S = 3.0
_SIMILAR = 0.75  # of two topics' names, as `difflib` rates them
# By what `qos_check_compatible` says of them.
_POLICIES = {
    "Best effort": "reliability",
    "Volatile": "durability",
    "deadline": "deadline",
    "liveliness": "liveliness",
}
# DDSI-RTPS: domain d has the ports 7400 + 250 d ...; participant p of it listens at offset 10 + 2 p. Beyond
# domain 100 they are among those that the kernel hands out for anything.
_FIRST_PORT, _PORTS_OF_DOMAIN, _DOMAINS = 7400, 250, 101


class Sender(NamedTuple):
    """Who publishes on a topic; ``name`` is empty for a DDS participant that is no ROS node."""

    name: str  # fully qualified
    middleware: str
    guid: str

    @property
    def label(self) -> str:
        """The node's name, or what is known of a participant without one."""
        if self.name:
            return self.name
        return f"a {self.middleware} participant without a ROS node ({self.guid[:24]})"


def middleware_of(endpoint: TopicEndpointInfo) -> str:
    """Return which DDS an endpoint is of, as far as its identity tells."""
    gid = bytes(endpoint.endpoint_gid)
    return _VENDORS.get(int.from_bytes(gid[:2], "big"), "unknown middleware")


class Senders:
    """The publishers of a topic of one type; a name that is not known in time is taken to be none."""

    def __init__(self, node: Node, topic: str, type_name: str) -> None:
        self._node = node
        self._topic = topic
        self._type_name = type_name
        self._first_seen: dict[str, float] = {}  # by GUID, monotonic clock

    def look(self) -> list[Sender]:
        """Return them; one whose name may still come has discovery's name for it."""
        senders = []
        for endpoint in self._node.get_publishers_info_by_topic(self._topic):
            if endpoint.topic_type != self._type_name:
                continue  # nobody receives what it says there
            guid = bytes(endpoint.endpoint_gid).hex()
            name = discovery.names([endpoint])[0]
            if name.endswith(topics.BARE_NODE):
                name = ""
            elif name.endswith(topics.UNKNOWN_NODE):
                since = self._first_seen.setdefault(guid, time.monotonic())
                if time.monotonic() - since >= UNNAMED_S:
                    name = ""
            senders.append(Sender(name, middleware_of(endpoint), guid))
        return senders


def near_misses(
    node: Node, topic: str, sends: str, type_name: str, own: Sequence[str]
) -> list[str]:
    """Return why nothing that can be used may arrive on a topic, a line each; ``sends``: as of `misfits`.

    ``own``: nodes and participants that are no candidates. Of domains, only those of this machine are known.
    """
    seen = [
        *_of_other_type(node, topic, type_name),
        *misfits(node, topic, sends, type_name),
        *_of_similar_name(node, topic, type_name, own),
    ]
    if not seen:
        seen += _in_other_domains(node.context.get_domain_id())
    if not seen and os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST":
        seen.append(
            "nothing like it; a DDS without ROS looks for others by multicast, which is not heard with "
            "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: see docs/controllers.md, or set SUBNET here"
        )
    return seen


def _of_other_type(node: Node, topic: str, type_name: str) -> Iterator[str]:
    for endpoint in node.get_publishers_info_by_topic(topic):
        if endpoint.topic_type != type_name:
            yield (
                f"{_shown(discovery.names([endpoint])[0])} publishes {endpoint.topic_type} on {topic}: "
                f"{type_name} is needed (in DDS sensor_msgs::msg::dds_::JointState_)"
            )


def misfits(node: Node, hears: str, sends: str, type_name: str) -> Iterator[str]:
    """Yield why who publishes on the topic that a node ``hears`` is not matched with it, by policies of QoS.

    Both endpoints of such a peer are compared with the node's own: what it publishes there, and what it hears
    of what the node ``sends``. Absolute names. Our subscriptions adapt to a best-effort publisher.
    """
    own = node.get_fully_qualified_name()
    peers = [e for e in node.get_publishers_info_by_topic(hears) if e.topic_type == type_name]
    for topic in (hears, sends):
        ends = node.get_publishers_info_by_topic(topic), node.get_subscriptions_info_by_topic(topic)
        theirs, ours = ends if topic == hears else ends[::-1]
        mine = [e for e in ours if discovery.names([e])[0] == own][:1]
        strange = [e for e in theirs if discovery.share_a_participant([e], peers)]
        for endpoint, own_end in product(strange, mine):
            pair = (endpoint, own_end) if topic == hears else (own_end, endpoint)
            _, reasons = qos_check_compatible(*(e.qos_profile for e in pair))
            for reason in re.findall(r"ERROR: ([^;]*)", reasons):
                policy = next((word for sign, word in _POLICIES.items() if sign in reason), "QoS")
                if (policy, topic) != ("reliability", hears):
                    verb = "publishes" if topic == hears else "subscribes to"
                    who = _shown(discovery.names([endpoint])[0])
                    fault = f"a {policy} that does not fit ({reason}): use the default"
                    yield f"{who} {verb} {topic} with {fault}"


def _of_similar_name(node: Node, topic: str, type_name: str, own: Sequence[str]) -> Iterator[str]:
    for name, types in node.get_topic_names_and_types():
        if name == topic or not _alike(name, topic):
            continue
        publishing = discovery.names(node.get_publishers_info_by_topic(name))
        others = [sender for sender in publishing if sender not in own]
        if others:
            kind = "" if type_name in types else f" as {', '.join(types)}"
            yield f"{', '.join(map(_shown, others))} publishes {name}{kind}: the topic is {topic}"


def _shown(name: str) -> str:
    """Return a node's name as a user knows it."""
    return "a participant without a ROS node" if name.endswith(topics.BARE_NODE) else name


def _alike(name: str, topic: str) -> bool:
    """Return True for names of which one may be meant by the other: similar, or in another namespace."""
    ends = name.rpartition("/")[2], topic.rpartition("/")[2]
    return ends[0] == ends[1] or SequenceMatcher(None, *ends).ratio() >= _SIMILAR


def _in_other_domains(own: int) -> Iterator[str]:
    """Yield the other domains in which a process of this machine takes part, by the ports that it holds."""
    holders = _port_holders()
    for domain in range(_DOMAINS):
        first = _FIRST_PORT + _PORTS_OF_DOMAIN * domain + 10
        processes = sorted({who for port, who in holders.items() if first <= port < first + 240})
        if domain != own and processes:
            yield (
                f"in ROS_DOMAIN_ID {domain} there is {', '.join(processes)}: this is {own}; "
                "give both the same"
            )


def _port_holders() -> dict[int, str]:
    """Return who holds each UDP port of this machine that a DDS may use, as far as this user may see it."""
    inodes: dict[str, int] = {}
    for table in ("/proc/net/udp", "/proc/net/udp6"):
        with suppress(OSError):
            for line in Path(table).read_text().splitlines()[1:]:
                fields = line.split()
                port = int(fields[1].rpartition(":")[2], 16)
                if _FIRST_PORT <= port < _FIRST_PORT + _PORTS_OF_DOMAIN * _DOMAINS:
                    inodes[f"socket:[{fields[9]}]"] = port
    holders: dict[int, str] = {}
    for process in Path("/proc").glob("[0-9]*") if inodes else ():
        with suppress(OSError):
            for descriptor in (process / "fd").iterdir():
                with suppress(OSError):
                    port = inodes.get(str(descriptor.readlink()), 0)
                    if port:
                        name = (process / "comm").read_text().strip()
                        holders[port] = f"{name} (process {process.name})"
    return holders
