"""Digests of a recording's whole content: any accidental damage or edit changes them.

The recorder writes them last; a reader computes them again. They are BLAKE2b, 32 bytes, over bytes that
do not depend on compression or on the limits of chunks:

- for each topic, its messages in the order of the file;
- ``heads``: length, channel, sequence, log time and publish time of every message in the order of the
  file, so the order across topics too;
- ``channels``: topic, encoding, metadata and schema of every channel;
- ``metadata``: every metadata record in the order of the file, except the digests themselves;
- ``header``: profile and library of the file; ``attachments``: how many there are.

They are not a secret: whoever rewrites a recording can write new digests. Who vouches for a file, its
signature says.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

    from .content import Content

# Names of our metadata records.
PROVENANCE, END, DIGESTS = "trunk_provenance", "trunk_end", "trunk_digests"
HEADS, CHANNELS, METADATA = "heads", "channels", "metadata"
HEADER, ATTACHMENTS = "header", "attachments"
# What is covered besides the topics, with its name in messages.
PARTS = {
    HEADS: "the messages' order, sequence numbers, log or publish times",
    CHANNELS: "the channels or schemas",
    METADATA: "the metadata records (origin, end)",
    HEADER: "the file's header",
    ATTACHMENTS: "the attachments",
}
_SIZE = 32


def _new() -> hashlib.blake2b:
    return hashlib.blake2b(digest_size=_SIZE)


def _of(values: object) -> str:
    text = json.dumps(values, ensure_ascii=True, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=_SIZE).hexdigest()


class RunningDigests:
    """The digests of a recording while it is written or read."""

    def __init__(self) -> None:
        self._topics: dict[str, hashlib.blake2b] = {}
        self._heads = _new()
        self._channels: list[object] = []
        self._metadata: list[object] = []
        self._header: list[str] = []
        self._attachments = 0

    def header(self, profile: str, library: str) -> None:
        """Take a file's header."""
        self._header += [profile, library]

    def channel(self, channel: Channel, schema: Schema | None) -> None:
        """Take a channel and its schema."""
        self._topics.setdefault(channel.topic, _new())
        description = [schema.name, schema.encoding, schema.data.hex()] if schema else []
        self._channels.append(
            [
                channel.id,
                channel.topic,
                channel.message_encoding,
                dict(channel.metadata),
                description,
            ]
        )

    def content(self, channels: Mapping[int, Channel], content: Content) -> None:
        """Take the messages of a block."""
        whole = content.messages(content.channels)
        if whole is not None:
            self.heads(whole.heads())
        for number, messages in content.channels.items():
            self.messages(channels[number].topic, messages.joined())

    def messages(self, topic: str, data: bytes) -> None:
        """Take one or more messages of a topic, without their heads."""
        self._topics.setdefault(topic, _new()).update(data)

    def heads(self, heads: bytes) -> None:
        """Take the heads of one or more message records, as they are in the file."""
        self._heads.update(heads)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Take a metadata record."""
        if name != DIGESTS:
            self._metadata.append([name, dict(values)])

    def attachment(self) -> None:
        """Take an attachment."""
        self._attachments += 1

    def values(self) -> dict[str, str]:
        """Return all digests so far, by the topic's name or the part."""
        return {
            **{topic: digest.hexdigest() for topic, digest in self._topics.items()},
            HEADS: self._heads.hexdigest(),
            CHANNELS: _of(self._channels),
            METADATA: _of(self._metadata),
            HEADER: _of(self._header),
            ATTACHMENTS: str(self._attachments),
        }


def differing(recorded: Mapping[str, str], computed: Mapping[str, str]) -> list[str]:
    """Return the topics and parts whose recorded digest is not the computed one."""
    return sorted(
        PARTS.get(key, key) for key, digest in recorded.items() if computed.get(key) != digest
    )


def uncoverable(topics: Iterable[str], attachments: int, unknown: Iterable[str]) -> list[str]:
    """Return the parts without digests: attachments, topics whose name is that of a part, unknown records."""
    parts = [f"a topic with the name {topic}" for topic in sorted(topics) if topic in PARTS]
    parts += ["the attachments' content"] if attachments else []
    kinds = ", ".join(sorted(set(unknown)))
    return parts + ([f"records of unknown kinds ({kinds})"] if kinds else [])


def uncovered(recorded: Mapping[str, str], topics: Iterable[str]) -> list[str]:
    """Return the parts, and those of ``topics``, that have no recorded digest."""
    return [PARTS.get(key, key) for key in (*sorted(topics), *PARTS) if key not in recorded]
