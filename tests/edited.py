"""A copy of a recording with a change, whose digests are kept, made anew or left out."""

from __future__ import annotations

import struct
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.writer import Writer

from trunk_msgs_util.recording.digests import DIGESTS, RunningDigests
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.recording.rosbag2 import RECORD, BagSummary, TopicCount, summary_record
from trunk_msgs_util.recording.writer import END, PROVENANCE

KEPT, ANEW, NONE = "kept", "anew", "none"
_HEAD = struct.Struct("<BQHIQQ")


@dataclass
class Content:
    """Everything in a recording that can be edited.

    A message is a list: topic, log time, bytes, publish time, sequence. A channel's key is its topic.
    """

    profile: str
    library: str
    messages: list[list]
    metadata: list[tuple[str, dict[str, str]]]
    channels: dict[str, Channel]
    schemas: dict[int, Schema]
    attachments: list[tuple[str, bytes]] = field(default_factory=list)
    summed_up: dict[str, str] = field(default_factory=dict)  # the summary as it was

    def of(self, topic):
        """Return the messages of a topic."""
        return [message for message in self.messages if message[0] == topic]

    def values(self, name):
        """Return the values of a metadata record."""
        return next(values for told, values in self.metadata if told == name)


def content(source: Path) -> Content:
    """Return what is in a recording."""
    with source.open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()
        messages = [
            [channel.topic, m.log_time, m.data, m.publish_time, m.sequence]
            for _, channel, m in reader.iter_messages(log_time_order=False)
        ]
        metadata = [(m.name, dict(m.metadata)) for m in reader.iter_metadata()]
    channels = {channel.topic: channel for channel in summary.channels.values()}
    found = Content(
        header.profile, header.library, messages, metadata, channels, dict(summary.schemas)
    )
    found.summed_up = dict(next((values for name, values in metadata if name == RECORD), {}))
    return found


def sum_up(found: Content) -> None:
    """Make the summary fit the messages again, as a forger would, unless the edit was to the summary."""
    counts = Counter(message[0] for message in found.messages)
    times = [message[1] for message in found.messages] or [0]
    told = []
    for topic, channel in found.channels.items():
        schema = found.schemas.get(channel.schema_id)
        told.append(TopicCount(channel.topic, schema.name if schema else "", counts[topic]))
    for name, values in found.metadata:
        if name == RECORD and values == found.summed_up:
            with suppress(ValueError):  # there is no such type
                values |= summary_record(BagSummary(tuple(told), min(times), max(times)))


def write(found: Content, path: Path, digests: str = KEPT) -> Recording:
    """Write a recording (`write_file`) and open it."""
    write_file(found, path, digests)
    return Recording.open(path)


def write_file(found: Content, path: Path, digests: str = KEPT) -> None:
    """Write a recording; its digests are `KEPT` as they were, written `ANEW`, or left out (`NONE`)."""
    if digests == ANEW:
        sum_up(found)
    running = RunningDigests()
    running.header(found.profile, found.library)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(found.profile, found.library)
        schemas = {
            number: writer.register_schema(schema.name, schema.encoding, schema.data)
            for number, schema in found.schemas.items()
        }
        numbers = {}
        for topic, channel in found.channels.items():
            schema = schemas.get(channel.schema_id, 0)
            numbers[topic] = writer.register_channel(
                channel.topic, channel.message_encoding, schema, channel.metadata
            )
            written = Channel(
                numbers[topic], channel.topic, channel.message_encoding, channel.metadata, schema
            )
            running.channel(written, found.schemas.get(channel.schema_id))
        records = [
            one
            for one in found.metadata
            if one[0] not in (DIGESTS, END) and not one[0].startswith("late ")
        ]
        last = [one for one in found.metadata if one not in records and one[0] != DIGESTS]
        for name, values in records:
            writer.add_metadata(name, values)
            running.metadata(name, values)
        for topic, log_time, data, publish_time, sequence in found.messages:
            number = numbers[topic]
            writer.add_message(number, log_time, data, publish_time, sequence)
            running.heads(_HEAD.pack(5, 22 + len(data), number, sequence, log_time, publish_time))
            running.messages(found.channels[topic].topic, data)
        for name, data in found.attachments:
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
            running.attachment()
        writer.flush()
        for name, values in last:
            writer.add_metadata(name, values)
            running.metadata(name, values)
        for name, values in found.metadata:
            if name == DIGESTS and digests == KEPT:
                writer.add_metadata(name, values)
        if digests == ANEW:
            writer.add_metadata(DIGESTS, running.values())
        writer.finish()


def copied(source, path, edit=lambda messages: None, digests=KEPT, end=True, provenance=None):
    """Write ``source`` again with ``edit`` applied to its messages.

    ``provenance``: values of the run's origin to replace.
    """
    found = content(source)
    edit(found.messages)
    found.values(PROVENANCE).update(provenance or {})
    if not end:
        found.metadata = [one for one in found.metadata if one[0] != END]
    return write(found, path, digests)
