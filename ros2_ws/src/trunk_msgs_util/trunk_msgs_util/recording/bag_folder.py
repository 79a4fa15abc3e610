"""The MCAP files of a rosbag2 folder, in order."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from .file import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

METADATA = "metadata.yaml"


class BagFolder(NamedTuple):
    """A bag's files; ``message_count`` is from its metadata, None without them."""

    files: list[Path]
    message_count: int | None


def bag_folder(folder: Path) -> BagFolder:
    """Return the files of a bag. Raises RecordingError if it cannot be read as one."""
    if not (folder / METADATA).is_file():
        files = sorted(folder.glob("*.mcap"), key=_natural)
        if not files:
            raise RecordingError(
                f"{folder} is a directory without {METADATA} and .mcap files: "
                "give a recording of a run"
            )
        return BagFolder(files, None)
    about = _information(folder / METADATA)
    storage = about.get("storage_identifier")
    if storage != "mcap":
        raise RecordingError(
            f"{folder} has the storage {storage!r}, only 'mcap' is read: "
            "convert it with ros2 bag convert or rosbags-convert"
        )
    mode = str(about.get("compression_mode") or "none").lower()
    if mode not in ("none", "storage"):
        raise RecordingError(
            f"{folder} is compressed by {mode}, which MCAP readers do not know: "
            "convert it with ros2 bag convert or rosbags-convert"
        )
    listed = about.get("relative_file_paths")
    if not isinstance(listed, list) or not listed:
        raise RecordingError(f"{folder / METADATA} lists no files: repair it with ros2 bag reindex")
    files = [_inside(folder, str(name)) for name in listed]
    count = about.get("message_count")
    return BagFolder(files, count if isinstance(count, int) else None)


def _information(path: Path) -> dict[str, Any]:
    try:
        about = yaml.safe_load(path.read_text("utf-8"))["rosbag2_bagfile_information"]
        if isinstance(about, dict):
            return about
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError, RecursionError):
        pass
    raise RecordingError(f"{path} does not describe a bag: repair it with ros2 bag reindex")


def _inside(folder: Path, name: str) -> Path:
    """Return a listed file by its bare name: paths in metadata from elsewhere are not trusted.

    Old bags list a file with their own folder's name before it.
    """
    path = folder / name.rsplit("/", 1)[-1]
    if path == folder or not path.is_file():
        raise RecordingError(f"{folder / METADATA} lists {name}, which is missing: restore it")
    return path


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts bag_2 before bag_10."""
    return [(int(p) if p.isdigit() else -1, p) for p in re.split(r"(\d+)", path.name)]
