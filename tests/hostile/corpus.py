"""Packs what the fuzzer found into the corpus that CI replays: python -m tests.hostile.corpus FOLDER

FOLDER is the ``corpus`` of scripts/fuzz_reader.sh. The shortest files come first, until the archive is as
large as it may be.
"""

import io
import lzma
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path

ARCHIVE = Path(__file__).resolve().parents[1] / "corpus.tar.xz"
MOST = 300_000  # bytes


def pack(folder: Path, archive: Path = ARCHIVE) -> int:
    """Write the archive; return how many files it has."""
    files = sorted({p.read_bytes() for p in folder.iterdir() if p.is_file()}, key=len)
    while len(packed := _packed(files)) > MOST:
        files = files[: int(0.9 * len(files))]
    archive.write_bytes(packed)
    return len(files)


def _packed(files: list[bytes]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        for number, data in enumerate(files):
            about = tarfile.TarInfo(f"{number:04}")
            about.size = len(data)
            tar.addfile(about, io.BytesIO(data))
    return lzma.compress(buffer.getvalue(), preset=9 | lzma.PRESET_EXTREME)


def unpacked(archive: Path = ARCHIVE) -> Iterator[bytes]:
    """Yield the corpus's files."""
    with tarfile.open(archive) as tar:
        for about in tar:
            file = tar.extractfile(about)
            if file is not None:
                yield file.read()


if __name__ == "__main__":
    print(f"{ARCHIVE}: {pack(Path(sys.argv[1]))} files")
