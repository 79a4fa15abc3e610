"""Packs what the fuzzer found into the corpus that CI replays: python -m tests.hostile.corpus FOLDER

FOLDER is one of scripts/fuzz_reader.sh, after ``-merge=1`` if it is large. The shortest files come first,
until the archive is as large as it may be.
"""

from __future__ import annotations

import hashlib
import sys
import zipfile
from pathlib import Path

ARCHIVE = Path(__file__).resolve().parents[1] / "corpus.zip"
MOST = 300_000  # bytes


def pack(folder: Path, archive: Path = ARCHIVE) -> int:
    """Write the archive; return how many files it has."""
    files = sorted({p.read_bytes() for p in folder.iterdir() if p.is_file()}, key=len)
    size = count = 0
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        for data in files:
            name = zipfile.ZipInfo(hashlib.blake2b(data, digest_size=8).hexdigest())
            name.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(name, data)
            size += name.compress_size + 2 * len(name.filename) + 80
            count += 1
            if size > MOST - 20_000:
                break
    return count


if __name__ == "__main__":
    print(f"{ARCHIVE}: {pack(Path(sys.argv[1]))} files")
