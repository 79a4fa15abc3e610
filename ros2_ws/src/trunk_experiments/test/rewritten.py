"""A copy of a recording with some of its messages changed or left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from mcap.reader import make_reader

from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.recording.writer import PROVENANCE, RecordingWriter

Edit = Callable[[str, bytes, int], bytes | None]


def rewritten(
    source: Path,
    path: Path,
    edit: Edit = lambda topic, data, index: data,
    provenance: Mapping[str, str] | None = None,
    more: Callable[[RecordingWriter, dict[str, int]], object] = lambda writer, channels: None,
    complete: bool = True,
    reason: str = "finished",
) -> Path:
    """Write ``source`` again with other digests.

    ``edit(topic, CDR, index in topic)`` gives a message's bytes, None to leave it out; topics are relative.
    ``provenance``: what to say instead of the source's. ``more``: writes to the new file, by its channels.
    """
    told = Recording.open(source).provenance if provenance is None else provenance
    channels: dict[str, int] = {}
    counts: Counter[str] = Counter()
    with source.open("rb") as file, RecordingWriter(path) as writer:
        writer.add_metadata(PROVENANCE, dict(told))
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            topic = channel.topic.removeprefix("/")
            if topic not in channels:
                channels[topic] = writer.channel(channel.topic, schema.name)
            data = edit(topic, message.data, counts[topic])
            counts[topic] += 1
            if data is not None:
                writer.write(channels[topic], message.log_time, message.publish_time, data)
        more(writer, channels)
        writer.finish(complete=complete, reason=reason)
    return path
