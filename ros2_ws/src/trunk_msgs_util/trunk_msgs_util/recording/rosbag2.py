"""What rosbag2 keeps beside the messages, so that its tools take a recording for one of their own.

Each channel's metadata has the quality of service that its publishers offered and its type's hash. From
these, `ros2 bag play` creates publishers that offer late subscriptions the past where the recorded ones
did. A metadata record, and ``metadata.yaml`` in a folder, sum up the bag. Version 9 of both, as Jazzy writes
them (rosbag2_storage/yaml.hpp and qos.cpp, rosbag2_storage_mcap/mcap_storage.cpp).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9

from .. import topics
from ..yaml_text import dump, load
from .schemas import type_hash

RECORD = "rosbag2"  # name of the metadata record
_SERIALIZED = "serialized_metadata"
_VERSION = 9
_INFINITE = QosTime(9223372036, 854775807)


class TopicCount(NamedTuple):
    """A topic in a bag's summary."""

    name: str
    type: str
    messages: int


class BagSummary(NamedTuple):
    """What a bag holds: its topics in the order of their channels, and its log times, ns."""

    topics: tuple[TopicCount, ...]
    first_ns: int
    last_ns: int


def channel_metadata(topic: str, type_name: str) -> dict[str, str]:
    """Return a channel's metadata. Raises ValueError for an unknown type."""
    return {
        "offered_qos_profiles": _text(_qos(_is_latched(topic))),
        "topic_type_hash": type_hash(type_name),
    }


def summary_record(summary: BagSummary) -> dict[str, str]:
    """Return the values of the metadata record; it names no file, since a file may be renamed."""
    return {_SERIALIZED: _text(_information(summary))}


def metadata_yaml(record: Mapping[str, str], file: str) -> str:
    """Return the text of ``metadata.yaml`` for a folder with one file, from that file's own record.

    Raises ValueError for a record that is not one of ours.
    """
    about = load(record.get(_SERIALIZED, ""))
    try:
        summed_up = {name: about[name] for name in ("starting_time", "duration", "message_count")}
    except (TypeError, KeyError) as error:
        raise ValueError(f"no summary of a bag: {error}") from None
    about |= {"relative_file_paths": [file], "files": [{"path": file, **summed_up}]}
    return _text({"rosbag2_bagfile_information": about}) + "\n"


def _information(summary: BagSummary) -> dict[str, Any]:
    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": summary.last_ns - summary.first_ns},
        "starting_time": {"nanoseconds_since_epoch": summary.first_ns},
        "message_count": sum(topic.messages for topic in summary.topics),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": _qos(_is_latched(topic.name)),
                    "type_description_hash": type_hash(topic.type),
                },
                "message_count": topic.messages,
            }
            for topic in summary.topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [],
        "files": [],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _is_latched(topic: str) -> bool:
    return any(topic.endswith(f"/{name}") for name in topics.LATCHED)


@cache
def _profile(latched: bool) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        topics.LATCHED_DEPTH if latched else topics.LIVE_DEPTH,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        _INFINITE,
        _INFINITE,
        QosLiveliness.AUTOMATIC,
        _INFINITE,
        False,
    )


def _qos(latched: bool) -> list[Any]:
    return list(dump_qos_v9([_profile(latched)]))


def _text(value: object) -> str:
    return dump(value, default_flow_style=False).rstrip("\n")
