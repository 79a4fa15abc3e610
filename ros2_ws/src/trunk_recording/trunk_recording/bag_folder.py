"""The MCAP files of a rosbag2 folder, in order."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

from trunk_core.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

METADATA = "metadata.yaml"
_SPLIT = re.compile(r"_\d+$")  # of a bag's parts: name_0.mcap, name_1.mcap
_LISTED = 8
_MAX_METADATA = 1 << 20  # characters


class BagFolder(NamedTuple):
    """A bag's files; ``message_count`` is from its metadata, None without them."""

    files: list[Path]
    message_count: int | None


def not_mcap(path: Path, why: str) -> RecordingError:
    """Return the error for what is not MCAP, with the command that makes MCAP of a bag."""
    return RecordingError(
        f"{path} is not an MCAP recording: {why}; "
        "to convert another kind of bag: rosbags-convert --src BAG --dst NEW --dst-storage mcap"
    )


def bag_folder(folder: Path) -> BagFolder:
    """Return the files of a bag. Raises RecordingError if it cannot be read as one.

    Without metadata, as after a recorder that was killed, only parts of one name are a bag.
    """
    if not (folder / METADATA).is_file():
        files = sorted(folder.glob("*.mcap"), key=_natural)
        if not files:
            raise not_mcap(folder, f"it has no {METADATA} and no .mcap files")
        if len(files) > 1 and len({_SPLIT.sub("", path.stem) for path in files}) > 1:
            names = ", ".join(path.name for path in files[:_LISTED])
            more = f" and {len(files) - _LISTED} more" if len(files) > _LISTED else ""
            raise RecordingError(
                f"{folder} has {len(files)} recordings and no {METADATA} that joins them: "
                f"give one of {names}{more}"
            )
        return BagFolder(files, None)
    about = _information(folder / METADATA)
    storage = about.get("storage_identifier")
    # rosbag2 leaves it empty where it indexes a folder anew.
    if storage != "mcap" and not (storage == "" and any(folder.glob("*.mcap"))):
        raise not_mcap(folder, f"its storage is {storage!r:.40}")
    mode = about.get("compression_mode") or "none"
    if not isinstance(mode, str) or mode.lower() not in ("none", "storage"):
        raise not_mcap(
            folder, f"it is compressed by {str(mode).lower():.40}, which MCAP readers do not know"
        )
    listed = about.get("relative_file_paths")
    if not isinstance(listed, list) or not listed:
        raise RecordingError(f"{folder / METADATA} lists no files: repair it with ros2 bag reindex")
    files = [_inside(folder, name) for name in listed]
    if len(set(files)) < len(files):
        raise RecordingError(
            f"{folder / METADATA} lists a file twice: repair it with ros2 bag reindex"
        )
    count = about.get("message_count")
    if count is not None and (not isinstance(count, int) or isinstance(count, bool) or count < 0):
        raise RecordingError(
            f"{folder / METADATA}: message_count is {count!s:.40}, a whole number is needed: "
            "repair it with ros2 bag reindex"
        )
    return BagFolder(files, count)


def _information(path: Path) -> dict[str, Any]:
    from trunk_core.yaml_text import (  # slow to import, and most recordings are files
        YamlTextError,
        load,
    )

    why = ""
    try:
        with path.open(encoding="utf-8") as file:
            tree = load(file.read(_MAX_METADATA + 1), _MAX_METADATA)
        about = tree["rosbag2_bagfile_information"]
        if isinstance(about, dict):
            return about
    except YamlTextError as error:
        why = f" ({error})"
    except (UnicodeDecodeError, KeyError, TypeError):
        pass
    raise RecordingError(f"{path} does not describe a bag{why}: repair it with ros2 bag reindex")


def _inside(folder: Path, listed: object) -> Path:
    """Return a listed file by its bare name: paths in metadata from elsewhere are not trusted.

    Old bags list a file with their own folder's name before it.
    """
    name = str(listed)[:255]
    path = folder / name.rsplit("/", 1)[-1].replace("\0", "")
    if path == folder or not path.is_file():
        raise RecordingError(f"{folder / METADATA} lists {name}, which is missing: restore it")
    return path


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts bag_2 before bag_10."""
    return [(int(p) if p.isdigit() else -1, p) for p in re.split(r"(\d+)", path.name)]
