"""MCAP's own conformance files, made here from the description of their variants: none is accused.

Six contents times ten features (chunks, indexes, statistics, repeated descriptions, padding at the end of
records): 416 files, as foxglove/mcap's tests/conformance generates them.
"""

import hashlib
import zlib
from itertools import chain, combinations

import pytest
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from trunk_recording.mcap_file import ERROR
from trunk_recording.reader import Recording
from trunk_recording.repair import recover
from trunk_recording.summary import structure

from .mcap_files import HEAD, MAGIC, finish, raw, record

PADDING = b"\x01\xff\xff"
# Formats that leave no room for extensions.
FIXED = (Message, DataEnd, Footer)
UNPADDED = (*FIXED, Chunk)  # in the published files

SCHEMA = Schema(id=1, data=b"\4\5\6", encoding="c", name="Example")
CHANNEL = Channel(id=1, topic="example", message_encoding="a", metadata={"foo": "bar"}, schema_id=1)
PLAIN = Channel(id=1, topic="example", message_encoding="text", metadata={}, schema_id=0)


def message(log_time, publish_time, sequence):
    return Message(1, log_time, b"\1\2\3", publish_time, sequence)


TIMES = (0, 2, 1, 3, 3, 5, 4, 7, 8, 9)
CONTENTS = {
    "NoData": [],
    "OneSchemalessMessage": [PLAIN, message(2, 1, 10)],
    "OneMessage": [SCHEMA, CHANNEL, message(2, 1, 10)],
    "OneAttachment": [Attachment(1, 2, "myFile", "application/octet-stream", b"\1\2\3")],
    "OneMetadata": [Metadata("myMetadata", {"foo": "bar"})],
    "TenMessages": [SCHEMA, CHANNEL, *(message(t, t, i) for i, t in enumerate(TIMES))],
}
FEATURES = ("ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum", "pad")
INDEXED = ("chx", "rsh", "rch", "mdx", "ax", "st")


def makes_sense(records, features):
    kinds = {type(record) for record in records}
    needs = {"ax": Attachment, "mdx": Metadata, "rsh": Schema, "rch": Channel}
    if any(feature in features and kind not in kinds for feature, kind in needs.items()):
        return False
    if {"ch", "chx", "mx"} & features and not kinds & {Message, Channel, Schema}:
        return False
    if "sum" in features and not features & set(INDEXED):
        return False
    return "ch" in features or not features & {"chx", "mx"}


VARIANTS = [
    (name, frozenset(features))
    for name in CONTENTS
    for features in chain.from_iterable(combinations(FEATURES, n) for n in range(len(FEATURES) + 1))
    if makes_sense(CONTENTS[name], set(features))
]


def made(content, features):
    """Return the bytes of a variant; records of kinds that may be extended are, with "pad"."""

    def add(data, entry):
        """Append a record; return where it begins, and its length."""
        at, written = len(data), record(entry)
        if "pad" in features and not isinstance(entry, UNPADDED) and data is not inside:
            written = raw(written[0], written[HEAD.size :] + PADDING)
        data += written
        return at, len(written)

    file, inside, entries = bytearray(MAGIC), bytearray(), []
    add(file, Header("", ""))
    messages = [entry for entry in content if isinstance(entry, Message)]
    start, end = (f((m.log_time for m in messages), default=0) for f in (min, max))
    groups = {kind: [] for kind in (Schema, Channel, Statistics, MetadataIndex, AttachmentIndex)}
    for entry in content:
        in_chunk = "ch" in features and isinstance(entry, Schema | Channel | Message)
        at, length = add(inside if in_chunk else file, entry)
        if in_chunk and isinstance(entry, Message):
            entries.append((entry.log_time, at))
        if isinstance(entry, Metadata) and "mdx" in features:
            groups[MetadataIndex].append(MetadataIndex(offset=at, length=length, name=entry.name))
        if isinstance(entry, Attachment) and "ax" in features:
            groups[AttachmentIndex].append(
                AttachmentIndex(at, length, 2, 1, len(entry.data), entry.name, entry.media_type)
            )
        if isinstance(entry, Schema) and "rsh" in features:
            groups[Schema].append(entry)
        if isinstance(entry, Channel) and "rch" in features:
            groups[Channel].append(entry)
    groups[ChunkIndex] = []
    if "ch" in features:
        data, n = bytes(inside), len(inside)
        at, length = add(file, Chunk("", data, end, start, zlib.crc32(data), n))
        places, size = {}, 0
        if "mx" in features:
            places[1], size = add(file, MessageIndex(1, entries))
        if "chx" in features:
            groups[ChunkIndex].append(ChunkIndex(length, at, "", n, end, size, places, start, n))
    if "st" in features:
        count = {kind: sum(isinstance(r, kind) for r in content) for kind in (Attachment, Channel)}
        count |= {kind: sum(isinstance(r, kind) for r in content) for kind in (Metadata, Schema)}
        counts = {1: len(messages)} if messages else {}
        groups[Statistics].append(
            Statistics(
                count[Attachment], count[Channel], counts, int("ch" in features), len(messages),
                end, start, count[Metadata], count[Schema],
            )
        )  # fmt: skip
    summary, offsets = bytearray(), bytearray()
    begins = len(file) + len(record(DataEnd(0)))
    for records in groups.values():
        at = len(summary)
        for entry in records:
            add(summary, entry)
        if len(summary) > at and "sum" in features:
            add(offsets, SummaryOffset(Opcode(summary[at]), begins + at, len(summary) - at))
    return finish(bytes(file), bytes(summary + offsets), offsets=len(offsets))


def test_they_are_the_published_files_byte_for_byte():
    """The digest is of the published files' SHA-256, by name."""
    digest = hashlib.sha256()
    for _, name, features in sorted(("-".join([n, *sorted(f)]), n, f) for n, f in VARIANTS):
        digest.update(hashlib.sha256(made(CONTENTS[name], features)).digest())
    assert len(VARIANTS) == 416
    assert digest.hexdigest() == "aa1fe3fa6fe1e1f07c382ad19b37c3c8d12904a4944cb1801f424d7e31a2fde2"


def opened(path):
    """Return the one file of a recording."""
    (file,) = Recording.open(path).opened
    return file


@pytest.mark.parametrize("name", CONTENTS)
def test_no_conformance_file_is_accused(tmp_path, name):
    path = tmp_path / "a.mcap"
    for content, features in VARIANTS:
        if content != name:
            continue
        path.write_bytes(made(CONTENTS[name], features))
        accused = [finding for finding in structure(opened(path)) if finding.severity == ERROR]
        recording = Recording.open(path)
        label = "-".join([name, *sorted(features)])
        assert (accused, recording.damage, recording.seen_otherwise) == ([], [], []), label
        assert recording.further_warnings == [], label
        with path.open("rb") as file:
            theirs = [
                (c.topic, m.log_time, m.data)
                for _, c, m in NonSeekingReader(file, validate_crcs=True).iter_messages(
                    log_time_order=False
                )
            ]
        ours = [
            (topic, log, data)
            for topic in recording.topics
            for block in recording.messages(topic)
            for log, data in zip(*block, strict=True)
        ]
        assert ours == theirs, label


@pytest.mark.parametrize("name", ["OneMessage", "OneSchemalessMessage", "TenMessages"])
def test_everything_in_a_conformance_file_is_recovered(tmp_path, name):
    for content, features in VARIANTS:
        if content == name:
            path, mended = tmp_path / "a.mcap", tmp_path / "b.mcap"
            path.write_bytes(made(CONTENTS[name], features))
            recovery = recover(path, mended, overwrite=True)
            assert (recovery.lost, recovery.count) == (
                [],
                len(CONTENTS[name]) - 2 + (name[3] == "S"),
            )
