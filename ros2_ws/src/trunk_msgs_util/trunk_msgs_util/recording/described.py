"""Records that describe a file: schemas, channels and metadata, read within limits."""

from __future__ import annotations

import hashlib
import struct
from contextlib import suppress
from typing import TYPE_CHECKING

from mcap.records import Channel, Metadata, Schema

from .limits import MAX_CHANNELS, MAX_NAME, LimitError

if TYPE_CHECKING:
    from .blocks import Record

_SHORT = 1 << 16  # bytes of others' metadata that are read
_NUMBER = struct.Struct("<H")


def numbered(record: Record) -> int | None:
    """Return the number with which a schema's or a channel's record begins; None without one."""
    return _NUMBER.unpack_from(record.body)[0] if len(record.body) >= _NUMBER.size else None


def of_others(record: Record) -> tuple[str, dict[str, str]]:
    """Return a metadata record that is not ours; only its digest if it is large or malformed."""
    if len(record.body) <= _SHORT:
        with suppress(Exception):  # whatever mcap may raise: nothing in it is needed
            metadata = Metadata.read(record.stream)
            return metadata.name, metadata.metadata
    return "", {"blake2b": hashlib.blake2b(record.body, digest_size=32).hexdigest()}


def check_described(count: int, item: Schema | Channel) -> None:
    """Raise LimitError for a schema or channel after so many others, or with too long a name."""
    what, name = ("schema", item.name) if isinstance(item, Schema) else ("topic", item.topic)
    if count >= MAX_CHANNELS:
        raise LimitError(f"more than {MAX_CHANNELS} {what}s")
    if len(name) > MAX_NAME:
        raise LimitError(
            f"the name of a {what} has {len(name)} characters: at most {MAX_NAME} are read"
        )
