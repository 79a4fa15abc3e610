"""Files whose index lies, and bags whose metadata do."""

import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

from mcap.records import ChunkIndex, McapRecord, Statistics
from ros2_ws.src.trunk_recording.test.mcap_files import chunk, finish, raw, record, start

from .bombs import _DESCRIBED, _joints

_CHUNK = chunk(_DESCRIBED + _joints(1, 0, ["hip", "trunk"]), compression="")


def _chunk_index(begins: int, indexes: dict[int, int], size: int) -> ChunkIndex:
    return ChunkIndex(len(_CHUNK), begins, "", 0, 0, size, indexes, 0, 0)


def _with_summary(path: Path, data: bytes, *summary: McapRecord) -> Path:
    path.write_bytes(finish(start() + data, record(*summary)))
    return path


def one_chunk_indexed_often(path: Path, count: int = 20_000) -> Path:
    """The index has the same chunk again and again, each with all that follows as its index."""
    first = len(start())
    entry = raw(7, struct.pack("<HI", 1, 16 * 60_000) + bytes(16 * 60_000))
    index = _chunk_index(first, {1: first + len(_CHUNK)}, len(entry))
    return _with_summary(path, _CHUNK + entry, *[index] * count)


def indexes_that_overlap(path: Path, count: int = 10_000) -> Path:
    """Each chunk's index is said to be all that follows."""
    first, each = len(start()), len(_CHUNK)
    summary = (_chunk_index(first + k * each, {1: first}, (count - k) * each) for k in range(count))
    return _with_summary(path, _CHUNK * count, *summary)


def damaged_everywhere(path: Path, count: int = 10_000) -> Path:
    """Before each chunk stands something that is no record: only the index finds the next chunk."""
    broken = raw(0x70, length=2**40)
    each = len(_CHUNK) + len(broken)
    summary = (_chunk_index(len(start()) + k * each, {}, 0) for k in range(count))
    return _with_summary(path, (_CHUNK + broken) * count, *summary)


def counts_of_nothing(path: Path) -> Path:
    """Statistics of 65,536 channels that do not exist."""
    counts = dict.fromkeys(range(65_536), 2**63)
    return _with_summary(path, _CHUNK, Statistics(0, 1, counts, 0, 2**64 - 1, 0, 0, 0, 1))


def _bag(path: Path, base: Path, about: str) -> Path:
    path.mkdir()
    shutil.copy(base, path / "a.mcap")
    text = f"rosbag2_bagfile_information:\n  storage_identifier: mcap\n{about}"
    (path / "metadata.yaml").write_text(text)
    return path


def bomb_of_aliases(name: str = "relative_file_paths") -> str:
    """Return ten lists, each of which has the one before ten times."""
    lines = ["  a0: &a0 [" + ", ".join(["lol"] * 10) + "]"]
    lines += [f"  a{k}: &a{k} [" + ", ".join([f"*a{k - 1}"] * 10) + "]" for k in range(1, 10)]
    return "\n".join([*lines, f"  {name}: *a9", ""])


def _aliases(name: str) -> Callable[[Path, Path], Path]:
    return lambda path, base: _bag(path, base, bomb_of_aliases(name))


def _fifo(path: Path, base: Path) -> Path:
    os.mkfifo(path)
    return path


INDEXED: dict[str, Callable[[Path], Path]] = {
    "one chunk, indexed often": one_chunk_indexed_often,
    "indexes that overlap": indexes_that_overlap,
    "damaged everywhere": damaged_everywhere,
    "counts of nothing": counts_of_nothing,
}

BAGS: dict[str, Callable[[Path, Path], Path]] = {
    "a bag whose files are a bomb of aliases": _aliases("relative_file_paths"),
    "a bag whose storage is a bomb of aliases": _aliases("storage_identifier"),
    "a bag whose compression is a bomb of aliases": _aliases("compression_mode"),
    "a bag with a deep list": lambda path, base: _bag(path, base, "  x: " + "[" * 100_000),
    "a bag with a deep mapping": lambda path, base: _bag(
        path, base, "  x: " + "{a: " * 900 + "}" * 900 + "\n"
    ),
    "a bag that lists a file often": lambda path, base: _bag(
        path, base, "  relative_file_paths: [" + "a.mcap, " * 5000 + "a.mcap]\n"
    ),
    "a bag with a long list": lambda path, base: _bag(
        path, base, "  relative_file_paths: [" + "b.mcap, " * 300_000 + "a.mcap]\n"
    ),
    "a bag that counts 10^4999 messages": lambda path, base: _bag(
        path, base, f"  relative_file_paths: [a.mcap]\n  message_count: 0x{'f' * 5000}\n"
    ),
    "a FIFO": _fifo,
}
