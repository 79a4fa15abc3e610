from __future__ import annotations

import tracemalloc

from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex
from mcap.stream_reader import StreamReader

from trunk_msgs_util.recording.chunk_indices import ChunkIndices
from trunk_msgs_util.recording.writer import RecordingWriter


def index(number: int) -> ChunkIndex:
    return ChunkIndex(
        chunk_length=900,
        chunk_start_offset=1000 * number,
        compression="zstd",
        compressed_size=850,
        message_end_time=2 * number + 1,
        message_index_length=70,
        message_index_offsets={channel: 1000 * number + channel for channel in range(1, 8)},
        message_start_time=2 * number,
        uncompressed_size=4000,
    )


def test_gives_back_what_it_took():
    indices = ChunkIndices()
    assert list(indices) == []
    for number in range(3):
        indices.append(index(number))
    assert list(indices) == [index(number) for number in range(3)]
    assert list(indices) == [index(number) for number in range(3)]  # and again


def test_a_file_has_the_index_of_its_chunks(run_file):
    path = run_file.write(20, flush_every=5)
    with path.open("rb") as file:
        chunks = [
            record
            for record in StreamReader(file, emit_chunks=True).records
            if isinstance(record, Chunk)
        ]
        file.seek(0)
        indexed = make_reader(file).get_summary().chunk_indexes
    assert len(chunks) == 5
    assert [(c.message_start_time, c.uncompressed_size) for c in chunks] == [
        (i.message_start_time, i.uncompressed_size) for i in indexed
    ]


def test_a_chunk_more_takes_little_memory(tmp_path):
    chunks = 1000
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        channel = writer.channel("/truth", "sensor_msgs/msg/JointState")

        def write() -> None:
            for stamp_ns in range(chunks):
                writer.write(channel, stamp_ns, stamp_ns, bytes(4))
                writer.flush()

        write()
        tracemalloc.start()
        write()
        taken, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert taken / chunks < 200  # bytes; 480 as mcap keeps it
