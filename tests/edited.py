"""A copy of a recording with a planted change, written by another library."""

from __future__ import annotations

from mcap.reader import make_reader
from mcap.writer import Writer

from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.recording.writer import DIGESTS, END, PROVENANCE


def copied(source, path, edit=lambda messages: None, digests=True, end=True, provenance=None):
    """Write ``source`` again with ``edit`` applied to its [topic, log time, bytes] list.

    ``provenance``: values of the run's origin that are to be others.
    """
    with source.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        messages = [
            [channel.topic, message.log_time, message.data]
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        metadata = [(m.name, m.metadata) for m in reader.iter_metadata()]
    edit(messages)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        channels = {}
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
        for name, values in metadata:
            if name == PROVENANCE:
                values = {**values, **(provenance or {})}
            if name not in (DIGESTS, END):
                writer.add_metadata(name, values)
        for topic, log_time, data in messages:
            writer.add_message(channels[topic], log_time, data, log_time)
        for name, values in metadata:
            if (name == DIGESTS and digests) or (name == END and end):
                writer.add_metadata(name, values)
        writer.finish()
    return Recording.open(path)
