"""What a recording is called: after its file, or after the folder of a run."""

from __future__ import annotations

from pathlib import Path

from trunk_msgs_util.files import resolve_path

IN_A_RUN = "run.mcap"  # the same in every run's folder


def place_of(path: Path) -> Path:
    """Return the file or folder that a recording goes by: of a run's file, the folder."""
    return resolve_path(path).parent if path.name == IN_A_RUN else resolve_path(path)


def name_of_run(path: Path) -> str:
    """Return a recording's name; empty for the root of all files.

    ``fig8/run.mcap`` and ``fig8`` give ``fig8``, so do ``run.mcap`` and ``.`` within that folder;
    ``mine.mcap`` gives ``mine``.
    """
    if path.suffix == ".mcap" and path.name != IN_A_RUN:
        return path.stem
    return place_of(path).name
